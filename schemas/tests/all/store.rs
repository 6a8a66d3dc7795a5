//! Files that appear whole or not at all, and records that match their schema.

use std::{
    fs,
    io::{self, Write},
    path::Path,
};

use omnilife_schemas::{
    Classified, ErrorKind,
    records::{
        Backend, Dataset, Direction, Failure, ResultRecord, Summary, VideoEntry, VideoStatus,
    },
    store::{self, StoreError},
};

fn dataset() -> Dataset {
    Dataset {
        videos: vec![
            VideoEntry {
                file: "a \"quoted\" näme.mp4".to_owned(),
                sha256: None,
                duration_seconds: Some(1.5),
                origin: None,
                status: VideoStatus::Failed {
                    reason: "zero bytes".to_owned(),
                },
            },
            VideoEntry {
                file: "b.mp4".to_owned(),
                sha256: Some(store::sha256_bytes(b"b")),
                duration_seconds: Some(1.5),
                origin: None,
                status: VideoStatus::Curated {
                    sequences: vec!["b/seq-000".to_owned()],
                },
            },
        ],
        not_taken: Vec::new(),
    }
}

fn result(mean: f64) -> ResultRecord {
    let summary = Summary {
        mean,
        views: 3,
        direction: Some(Direction::HigherIsBetter),
        standard_deviation: Some(0.25),
        undefined_views: 0,
    };
    ResultRecord {
        scene_sha256: store::sha256_bytes(b"street"),
        protocol: "per-scene/1".to_owned(),
        protocol_hash: store::sha256_bytes(b""),
        scored_size: [64, 32],
        input_views: [("psnr".to_owned(), summary)].into(),
        novel_views: [("psnr".to_owned(), summary)].into(),
        failures: vec![Failure {
            view: "novel".to_owned(),
            frame: 4,
            reason: "000004.png is missing".to_owned(),
        }],
        training_seconds: Some(0.1 + 0.2),
        iterations: Some(u64::MAX),
        seed: Some(7),
        backend: Some(Backend::Cpu { threads: 2 }),
        rendering_seconds: Some(0.3),
        ..ResultRecord::new("odgs", "street")
    }
}

#[test]
fn a_failed_write_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.csv");
    let error = store::write_with(&path, |writer| {
        writer.write_all(&[b'x'; 100_000])?;
        Err(io::Error::other("the source broke off"))
    })
    .unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::Internal);
    assert_eq!(
        error.to_string(),
        format!(
            "{}: cannot be written: the source broke off",
            path.display()
        )
    );
    assert!(store::names_in(folder.path()).unwrap().is_empty());
}

#[test]
fn a_failed_write_keeps_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.csv");
    store::write_bytes(&path, b"old").unwrap();
    let failed = store::write_with(&path, |writer| {
        writer.write_all(b"new")?;
        Err(io::Error::other("no"))
    });
    assert!(failed.is_err());
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(store::names_in(folder.path()).unwrap(), ["table.csv"]);
}

/// The temporary name leads to a device that is always full. One write fails when the buffer is flushed at the end,
/// the other while it is filled.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_keeps_the_old_file() {
    for size in [10, 1_000_000] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        store::write_bytes(&path, b"old").unwrap();
        std::os::unix::fs::symlink("/dev/full", store::temporary_beside(&path)).unwrap();
        let error = store::write_bytes(&path, &vec![0; size]).unwrap_err();
        assert!(error.to_string().contains("No space left"), "{error}");
        assert_eq!(error.error_kind(), ErrorKind::Internal);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(store::names_in(folder.path()).unwrap(), ["image.png"]);
    }
}

/// A file renamed onto `/dev/stdout` or `/dev/null` would take its place for every program.
#[cfg(unix)]
#[test]
fn a_socket_is_not_replaced() {
    use std::os::unix::{fs::FileTypeExt, net::UnixListener};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.csv");
    let listener = UnixListener::bind(&path).unwrap();
    let error = store::write_bytes(&path, b"x").unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User, "{error}");
    assert!(fs::metadata(&path).unwrap().file_type().is_socket());
    assert_eq!(store::names_in(folder.path()).unwrap(), ["table.csv"]);
    drop(listener);
}

#[test]
fn a_missing_folder_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nowhere/table.csv");
    let error = store::write_bytes(&path, b"x").unwrap_err();
    assert!(error.to_string().starts_with(&path.display().to_string()));
    assert!(matches!(error, StoreError::Write { .. }));
}

#[test]
fn temporary_names_lie_beside_and_keep_the_extension() {
    let path = Path::new("/data/run/000004.png");
    let temporary = store::temporary_beside(path);
    assert_eq!(temporary.parent(), path.parent());
    assert_eq!(temporary.extension(), path.extension());
    assert_ne!(temporary, path);
}

/// Only leftovers of another process under a temporary name are removed.
#[test]
fn what_a_killed_process_left_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let ours = store::temporary_beside(&path("record.json"));
    for file in [&ours, &path("record.json"), &path(".tmp-notes")] {
        fs::write(file, b"kept").unwrap();
    }
    // An id that no process has.
    let own_id = format!("-{}-", std::process::id());
    let dead = |name: &str| {
        let temporary = store::temporary_beside(&path(name));
        let temporary = temporary
            .file_name()
            .unwrap()
            .to_string_lossy()
            .into_owned();
        path(&temporary.replacen(&own_id, "-8388608-", 1))
    };
    fs::write(dead("record.json"), b"half").unwrap();
    fs::create_dir(dead("sequences")).unwrap();
    fs::write(dead("sequences").join("0.png"), b"half").unwrap();
    store::remove_abandoned(folder.path()).unwrap();
    let mut kept = store::names_in(folder.path()).unwrap();
    kept.sort();
    let own = ours.file_name().unwrap().to_string_lossy().into_owned();
    let mut expected = vec![own, ".tmp-notes".to_owned(), "record.json".to_owned()];
    expected.sort();
    assert_eq!(kept, expected);
    store::remove_abandoned(&path("nowhere")).unwrap();
}

/// A record that has not changed keeps its file as it is.
#[test]
fn an_unchanged_record_is_not_written_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record.json");
    store::update_record(&path, &dataset()).unwrap();
    let written = fs::metadata(&path).unwrap().modified().unwrap();
    store::update_record(&path, &dataset()).unwrap();
    assert_eq!(fs::metadata(&path).unwrap().modified().unwrap(), written);
    let other = Dataset {
        videos: Vec::new(),
        not_taken: Vec::new(),
    };
    store::update_record(&path, &other).unwrap();
    assert_eq!(store::read_record::<Dataset>(&path).unwrap(), other);
}

#[test]
fn records_come_back_with_their_tag_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record.json");
    store::write_record(&path, &dataset()).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("{\n  \"schema\": \"omnilife/dataset/1\",\n"));
    assert!(text.ends_with("}\n"));
    assert_eq!(store::read_record::<Dataset>(&path).unwrap(), dataset());

    store::write_record(&path, &result(27.123_456_789_012_345)).unwrap();
    assert_eq!(
        store::read_record::<ResultRecord>(&path).unwrap(),
        result(27.123_456_789_012_345)
    );
}

#[test]
fn a_record_that_json_cannot_hold_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("result.json");
    for value in [f64::NAN, f64::INFINITY] {
        let error = store::write_record(&path, &result(value)).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::Internal);
    }
    assert!(store::names_in(folder.path()).unwrap().is_empty());
}

#[test]
fn another_schema_is_named_in_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("result.json");
    store::write_record(&path, &dataset()).unwrap();
    let error = store::read_record::<ResultRecord>(&path).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert_eq!(
        error.to_string(),
        format!(
            "{}: is of schema omnilife/dataset/1, expected omnilife/result/3",
            path.display()
        )
    );
}

#[test]
fn broken_records_are_input_errors_of_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset.json");
    let whole = store::record_bytes(&dataset()).unwrap();
    for (content, expected) in [
        (&b""[..], "not a JSON record"),
        (b"frames: 3", "not a JSON record"),
        (b"[1, 2]", "not a JSON record"),
        (b"{\"videos\": []}", "has no \"schema\" entry"),
        (
            b"{\"schema\": \"omnilife/dataset/1\"}",
            "missing field `videos`",
        ),
        (&whole[..whole.len() / 2], "not a JSON record"),
        // Python writes such numbers.
        (b"{\"a\":\n  NaN}", "got NaN at line 2 column 3"),
        (
            b"{\"a\": [1, -Infinity]}",
            "got Infinity at line 1 column 12",
        ),
        (b"{\"a\": nothing}", "expected ident"),
        (
            b"\xff\xfe",
            "omnilife/dataset/1, got a file that is not text",
        ),
    ] {
        fs::write(&path, content).unwrap();
        let error = store::read_record::<Dataset>(&path).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(expected), "{message}");
        assert!(
            message.starts_with(&path.display().to_string()),
            "{message}"
        );
        assert!(!message.contains('\n'), "{message}");
        assert_eq!(error.error_kind(), ErrorKind::User);
    }
}

#[test]
fn a_file_in_no_folder_is_told_from_one_that_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let message = |path: &str| {
        let error = store::read_text(&folder.path().join(path)).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        error.to_string()
    };
    assert!(message("missing/scene.json").ends_with("its folder does not exist"));
    assert!(message("file/scene.json").ends_with("its folder is a file"));
    assert!(!message("scene.json").contains("its folder"));
    let error = store::create_folder(&folder.path().join("file")).unwrap_err();
    assert!(error.to_string().contains("needs a folder"), "{error}");
}

#[test]
fn hashes_are_sha256() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("abc");
    // FIPS 180-2, appendix B.1 and B.3.
    let cases = [
        (
            b"abc".to_vec(),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        ),
        (
            vec![b'a'; 1_000_000],
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0",
        ),
    ];
    for (bytes, expected) in cases {
        fs::write(&path, &bytes).unwrap();
        assert_eq!(store::sha256_bytes(&bytes), expected);
        assert_eq!(store::sha256_file(&path).unwrap(), expected);
    }
    assert!(store::sha256_file(&folder.path().join("missing")).is_err());
}

#[test]
fn a_result_of_the_version_before_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("result.json");
    store::write_record(&path, &result(1.0)).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let older = text
        .replace("omnilife/result/3", "omnilife/result/2")
        .replace("\"primitives\": null", "\"gaussians\": 7");
    assert_ne!(older, text);
    fs::write(&path, older).unwrap();
    let read: ResultRecord = store::read_record(&path).unwrap();
    assert_eq!(read.primitives, Some(7));
    omnilife_schemas::records::check_file(&path).unwrap();
}

/// Editors of some systems write a byte order mark at the start of files.
#[test]
fn a_byte_order_mark_is_no_part_of_a_text() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset.json");
    store::write_record(&path, &dataset()).unwrap();
    let text = store::read_text(&path).unwrap();
    fs::write(&path, format!("\u{feff}{text}")).unwrap();
    assert_eq!(store::read_text(&path).unwrap(), text);
    assert_eq!(store::read_record::<Dataset>(&path).unwrap(), dataset());
    assert!(store::schema_of(&path).unwrap().starts_with("omnilife/"));
    // Only the first one is a mark.
    fs::write(&path, "\u{feff}\u{feff}a").unwrap();
    assert_eq!(store::read_text(&path).unwrap(), "\u{feff}a");
}
