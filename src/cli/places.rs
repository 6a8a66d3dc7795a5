//! Places on the command line: a record may be named by its file or by the folder that it lies in.

use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use omnilife_bench::external::EXTERNAL_RUN_FILE;
use omnilife_schemas::{
    layout::{ANALYSIS_FILE, DATASET_FILE, RUN_FILE, SCENE_FILE, SEQUENCE_FILE, SPLIT_FILE},
    records::{Dataset, VideoStatus},
    store,
};

/// Parts that a message lists at most.
const MOST_LISTED: usize = 8;

/// A scene.json, or the folder of one.
pub(super) fn scene_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new()
        .try_map(|path| part(path, SCENE_FILE).map(|path| file_in(path, SCENE_FILE)))
}

/// A split.json, or the folder of one.
pub(super) fn split_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| file_in(path, SPLIT_FILE))
}

/// The record of a run of this program or of an external method, or the folder of one.
pub(super) fn run_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| {
        let external = path.join(EXTERNAL_RUN_FILE);
        if external.is_file() && !path.join(RUN_FILE).is_file() {
            external
        } else {
            file_in(path, RUN_FILE)
        }
    })
}

/// The folder of a scene, or the scene.json in it.
pub(super) fn scene_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new()
        .try_map(|path| part(path, SCENE_FILE).map(|path| folder_of(path, SCENE_FILE)))
}

/// The folder of a sequence, or the sequence.json in it.
pub(super) fn sequence_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new()
        .try_map(|path| part(path, SEQUENCE_FILE).map(|path| folder_of(path, SEQUENCE_FILE)))
}

/// The folder of a curated video.
pub(super) fn video_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| part(path, ANALYSIS_FILE))
}

/// The folder of a dataset, or the dataset.json in it.
pub(super) fn dataset_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| folder_of(path, DATASET_FILE))
}

/// Poses: a scene.json is meant by its folder, as long as the folder holds one.
pub(super) fn poses() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match path.join(SCENE_FILE) {
        file if file.is_file() => Ok(file),
        _ => part(path, SCENE_FILE),
    })
}

/// Returns a path of a part of a dataset, whose folder holds `record`.
///
/// # Errors
/// When it is that of the dataset: the message lists the parts.
fn part(path: PathBuf, record: &str) -> Result<PathBuf, String> {
    let folder = folder_of(path.clone(), DATASET_FILE);
    let file = folder.join(DATASET_FILE);
    if !file.is_file() || folder.join(record).is_file() {
        return Ok(path);
    }
    let dataset: Dataset = store::read_record(&file).map_err(|error| error.to_string())?;
    let mut parts: Vec<PathBuf> = Vec::new();
    for video in &dataset.videos {
        if let VideoStatus::Curated { sequences } = &video.status {
            parts.extend(sequences.iter().map(|sequence| folder.join(sequence)));
        }
    }
    let kind = if record == ANALYSIS_FILE {
        "videos"
    } else {
        "sequences"
    };
    if record == ANALYSIS_FILE {
        parts = (parts.iter().filter_map(|sequence| sequence.parent()))
            .map(Path::to_owned)
            .collect();
        parts.dedup();
    }
    let named = parts
        .iter()
        .take(MOST_LISTED)
        .map(|part| format!("\n  {}", part.display()));
    let named: String = named.collect();
    let others = match parts.len().saturating_sub(MOST_LISTED) {
        0 => String::new(),
        count => format!("\n  and {count} more"),
    };
    Err(format!(
        "is a dataset; name one of its {kind}:{named}{others}"
    ))
}

fn file_in(path: PathBuf, name: &str) -> PathBuf {
    if path.is_dir() { path.join(name) } else { path }
}

fn folder_of(path: PathBuf, name: &str) -> PathBuf {
    let is_record = path.is_file() && path.file_name().is_some_and(|file| file == name);
    match path.parent() {
        Some(parent) if is_record && parent == Path::new("") => PathBuf::from("."),
        Some(parent) if is_record => parent.to_owned(),
        _ => path,
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::VideoEntry;

    use super::*;

    #[test]
    fn a_dataset_lists_its_parts_where_one_is_needed() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let names = (0..MOST_LISTED + 2).map(|index| format!("videos/walk/seq-{index:03}"));
        let record = Dataset {
            videos: vec![VideoEntry {
                file: "walk.mp4".to_owned(),
                sha256: None,
                duration_seconds: None,
                origin: None,
                status: VideoStatus::Curated {
                    sequences: names.collect(),
                },
            }],
            not_taken: Vec::new(),
        };
        let file = folder.path().join(DATASET_FILE);
        store::write_record(&file, &record)?;
        for given in [folder.path(), file.as_path()] {
            let message = part(given.to_owned(), SCENE_FILE).err().unwrap_or_default();
            let first = folder.path().join("videos/walk/seq-000");
            assert!(message.contains(&first.display().to_string()), "{message}");
            assert!(
                message.contains("seq-007") && !message.contains("seq-008"),
                "{message}"
            );
            assert!(message.contains("2 more"), "{message}");
            let message = part(given.to_owned(), ANALYSIS_FILE)
                .err()
                .unwrap_or_default();
            assert!(
                message.contains("videos/walk") && !message.contains("seq-"),
                "{message}"
            );
        }
        let sequence = folder.path().join("videos/walk/seq-000");
        assert_eq!(part(sequence.clone(), SCENE_FILE), Ok(sequence));
        Ok(())
    }

    #[test]
    fn a_record_is_found_by_its_folder_and_the_other_way_round() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let scene = folder.path().join(SCENE_FILE);
        assert_eq!(file_in(folder.path().to_owned(), SCENE_FILE), scene);
        assert_eq!(file_in(scene.clone(), SCENE_FILE), scene);
        // A folder of a file that is not there is named as it was given.
        assert_eq!(folder_of(scene.clone(), SCENE_FILE), scene);
        std::fs::write(&scene, "")?;
        assert_eq!(folder_of(scene, SCENE_FILE), folder.path());
        Ok(())
    }
}
