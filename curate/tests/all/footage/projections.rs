//! The ERP projection on versions of real and rendered footage in other projections and layouts, made
//! by `scripts/fixtures/projections`.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_curate::{analysis::analyse, boundaries::DETECTORS, projection::judge};
use omnilife_schemas::{progress::Silent, store::paths_in};

use crate::support;

fn repository(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file)
}

/// Makes all versions of a clip and lists those that are taken for something else.
fn mistaken(source: &Path) -> Vec<String> {
    let temp = tempfile::tempdir().unwrap();
    let made = Command::new(repository("scripts/fixtures/projections"))
        .args([source, temp.path()])
        .arg("0.4")
        .status()
        .unwrap();
    assert!(made.success());
    let mut mistaken = Vec::new();
    for folder in paths_in(temp.path()).unwrap() {
        for video in paths_in(&folder).unwrap() {
            let analysis = analyse(&video, &DETECTORS[0], None, &Silent).unwrap();
            let projection = judge(&analysis.probe, analysis.samples.images());
            let expected = folder.file_name().unwrap().to_string_lossy();
            if projection.projection.name() != expected {
                let values: Vec<String> = projection
                    .evidence
                    .iter()
                    .map(|evidence| format!("{} {:.3}", evidence.test, evidence.value))
                    .collect();
                mistaken.push(format!(
                    "{} of {}: {} instead of {expected} ({})",
                    video.file_stem().unwrap().to_string_lossy(),
                    source.display(),
                    projection.projection.name(),
                    values.join(", ")
                ));
            }
        }
    }
    mistaken
}

#[test]
fn every_version_of_the_sample_is_recognized() {
    let found = mistaken(&repository("tests/data/street/street.mp4"));
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn every_version_of_real_footage_is_recognized() {
    for name in ["reef.mp4", "tunnel.mp4"] {
        let Some(source) = support::shared_data(name) else {
            continue;
        };
        let found = mistaken(&source);
        assert!(found.is_empty(), "{}", found.join("\n"));
    }
}
