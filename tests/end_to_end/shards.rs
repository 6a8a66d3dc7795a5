//! Shards of a dataset (`omnilife curate publish --shards`): its frames as archives that loaders read.

use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};

use omnilife_schemas::testing::skip;

use crate::support::{copy_of_small_run, files, omnilife};

fn publish(dataset: &Path, further: &[&str]) {
    let dataset = dataset.to_str().unwrap();
    let words = ["curate", "publish", dataset].into_iter();
    omnilife(words.chain(further.iter().copied())).succeeded();
    omnilife(["curate", "verify", dataset, "--quiet"]).succeeded();
}

fn shards(dataset: &Path) -> Vec<(String, Vec<u8>)> {
    let shards = files(dataset)
        .into_iter()
        .filter(|file| file.starts_with("shards/"));
    shards
        .map(|file| (file.clone(), fs::read(dataset.join(file)).unwrap()))
        .collect()
}

/// Returns the findings of Python's own module, or of the library `webdataset`.
fn read_by(python: &str, dataset: &Path, library: Option<&str>) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/read_shards.py");
    let read = Command::new(python)
        .arg(script)
        .arg(dataset)
        .args(library)
        .output()
        .unwrap();
    let notes = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{notes}");
    String::from_utf8(read.stdout).unwrap().trim().to_owned()
}

#[test]
fn shards_hold_every_frame_and_are_the_same_bytes_again() {
    let (one, other) = (copy_of_small_run(), copy_of_small_run());
    publish(one.path(), &[]);
    let before = files(one.path());
    publish(one.path(), &["--shards", "0.1"]);
    let made = shards(one.path());
    assert!(made.len() > 1, "{} shards", made.len());
    let largest = made.iter().map(|(_, content)| content.len()).max();
    // The end of an archive comes on top.
    assert!(largest <= Some(100_000 + 1024), "{largest:?}");
    publish(other.path(), &["--shards", "0.1"]);
    assert!(
        made == shards(other.path()),
        "the same dataset, other bytes"
    );
    let card = fs::read_to_string(one.path().join("README.md")).unwrap();
    assert!(
        card.contains("- config_name: frames\n  data_files: shards/frames-*.tar\n---\n"),
        "{card}"
    );

    let python = std::env::var("OMNILIFE_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = |module: &str| {
        let asked = Command::new(&python)
            .args(["-c", &format!("import {module}")])
            .stderr(Stdio::null())
            .status();
        asked.is_ok_and(|status| status.success())
    };
    if has("tarfile") {
        let expected = format!("{} 10 ['json', 'mask.png', 'png']", made.len());
        assert_eq!(read_by(&python, one.path(), None), expected);
        if has("webdataset") {
            let library = Some("webdataset");
            assert_eq!(read_by(&python, one.path(), library), expected);
        } else {
            skip("no Python with webdataset (pip install webdataset)");
        }
    } else {
        skip("no python3");
    }

    publish(one.path(), &["--shards", "1000"]);
    assert_eq!(shards(one.path()).len(), 1);
    publish(one.path(), &[]);
    assert_eq!(files(one.path()), before);
}
