//! Places on the command line: a record may be named by its file or by the folder that it lies in.

use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use omnilife_bench::external::EXTERNAL_RUN_FILE;
use omnilife_schemas::layout::{DATASET_FILE, RUN_FILE, SCENE_FILE, SPLIT_FILE};

/// A scene.json, or the folder of one.
pub(super) fn scene_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| file_in(path, SCENE_FILE))
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
    PathBufValueParser::new().map(|path| folder_of(path, SCENE_FILE))
}

/// The folder of a dataset, or the dataset.json in it.
pub(super) fn dataset_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| folder_of(path, DATASET_FILE))
}

/// Poses: a scene.json is meant by its folder, as long as the folder holds one.
pub(super) fn poses() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| match path.join(SCENE_FILE) {
        file if file.is_file() => file,
        _ => path,
    })
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
    use super::*;

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
