//! Published records do not depend on the machine: no folder, and no advice to its user.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{
    CurateSettings, curate_dataset,
    publish::{PublishSettings, publish, verify},
};
use omnilife_schemas::{
    progress::Silent,
    records::{Sampling, VideoStatus},
    testing::Notes,
};
use support::{Clip, erp_clip, world_colour};

use crate::support;

const TELL_TALE: &str = "ann-b's private disk";

/// Two of one name, one again, one that is not a sphere, one that is not a video.
const VIDEOS: [&str; 5] = [
    "day/walk.mp4",
    "night/walk.mp4",
    "copy.mp4",
    "flat.mp4",
    "text.mp4",
];

fn footage(folder: &Path) {
    for name in ["day", "night"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let walk = erp_clip(folder, VIDEOS[0], &[1], 40, 20);
    erp_clip(folder, VIDEOS[1], &[3], 40, 20);
    fs::copy(walk, folder.join(VIDEOS[2])).unwrap();
    Clip::steady(320, 180, 40, 20).write(&folder.join(VIDEOS[3]), |frame, x, y| {
        let (u, v) = (x as f64 / 160.0 - 1.0, y as f64 / 160.0 - 0.56);
        world_colour(1, [1.7 * u, 2.3 * v, 0.3 * u * v + 0.01 * frame as f64])
    });
    fs::write(folder.join(VIDEOS[4]), "dear diary").unwrap();
}

/// Paths and contents of all published files; binary ones are read as text.
fn published(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if name.starts_with('.') {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
                found.push((path, text));
            }
        }
    }
    found
}

#[test]
fn no_published_file_names_a_folder_of_the_machine() {
    let temp = tempfile::tempdir().unwrap();
    let at = |mount: &str| temp.path().join(mount).join(TELL_TALE);
    footage(&at("mount"));
    for file in VIDEOS {
        let copy = at("other").join(file);
        fs::create_dir_all(copy.parent().unwrap()).unwrap();
        fs::copy(at("mount").join(file), copy).unwrap();
    }
    let settings = CurateSettings {
        profile: "none".to_owned(),
        sampling: Sampling::MaxFrames(2),
        ..CurateSettings::default()
    };
    let out = |mount: &str| temp.path().join(format!("set-of-{mount}"));
    let mut tables = Vec::new();
    for mount in ["mount", "other"] {
        let videos = VIDEOS.map(|file| at(mount).join(file));
        let (out, notes) = (out(mount), Notes::default());
        let curated = curate_dataset(&videos, &out, &settings, &notes).unwrap();
        let names: Vec<&str> = curated
            .record
            .videos
            .iter()
            .map(|video| video.file.as_str())
            .collect();
        assert_eq!(names, VIDEOS);
        let statuses: Vec<&VideoStatus> = curated
            .record
            .videos
            .iter()
            .map(|video| &video.status)
            .collect();
        assert!(
            matches!(
                statuses[..],
                [
                    VideoStatus::Curated { .. },
                    VideoStatus::Curated { .. },
                    VideoStatus::Duplicate { of },
                    VideoStatus::Rejected { .. },
                    VideoStatus::Failed { .. },
                ] if of == "day/walk.mp4"
            ),
            "{statuses:?}"
        );
        // The terminal has both.
        let [(3, rejected), (4, failed)] = &curated.errors[..] else {
            panic!("{:?}", curated.errors);
        };
        let (rejected, failed) = (rejected.to_string(), failed.to_string());
        assert!(rejected.contains(TELL_TALE) && rejected.contains("--"));
        assert!(failed.contains(TELL_TALE), "{failed}");
        assert!(notes.take().iter().any(|line| line.contains(TELL_TALE)));
        drop(curated);
        let name = Some("walks".to_owned());
        let settings = PublishSettings {
            name,
            shard_bytes: Some(1 << 20),
            ..PublishSettings::default()
        };
        publish(&out, &settings, &Silent).unwrap();
        assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);
        let place = temp.path().to_str().unwrap();
        let files = published(&out);
        assert!(files.len() > 10, "{}", files.len());
        for (path, text) in &files {
            for told in [TELL_TALE, place, "--accept", "--projection", "--criteria"] {
                assert!(!text.contains(told), "{}: {told}", path.display());
            }
        }
        tables.push(
            ["dataset.json", "attrition.csv", "README.md"]
                .map(|file| fs::read_to_string(out.join(file)).unwrap()),
        );
    }
    assert_eq!(tables[0], tables[1]);
}
