//! Which videos the paths on the command line stand for.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::store;

use crate::{error::CurateError, stills};

/// File name extensions of videos, in lower case.
pub const VIDEO_EXTENSIONS: &[&str] = &["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "ts"];

/// Extensions of other videos, in lower case: those of cameras and discs, which are read where they are named, and
/// those that the programs of cameras' makers have to stitch first.
const OTHER_VIDEO_EXTENSIONS: &[&str] = &[
    "360", "3gp", "asf", "dv", "f4v", "flv", "insv", "lrv", "m2t", "m2ts", "m2v", "mpeg", "mts",
    "mxf", "ogv", "vob", "wmv",
];

/// Replaces every folder by the videos directly in it, sorted by name; files stay as they are, and so does a folder of
/// images without videos: still panoramas.
///
/// # Errors
/// [`CurateError::Input`] for a path that does not exist and for a folder without videos and images.
pub fn expand_inputs(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CurateError> {
    let mut videos = Vec::new();
    for path in paths {
        if path.is_dir() {
            videos.extend(videos_in(path)?);
        } else if path.exists() {
            videos.push(path.clone());
        } else {
            return Err(CurateError::input(path, "does not exist"));
        }
    }
    Ok(videos)
}

fn videos_in(folder: &Path) -> Result<Vec<PathBuf>, CurateError> {
    let videos: Vec<PathBuf> = store::paths_in(folder)?
        .into_iter()
        .filter(|path| path.is_file() && has_extension(path, VIDEO_EXTENSIONS))
        .collect();
    if videos.is_empty() && stills::has_images(folder)? {
        return Ok(vec![folder.to_owned()]);
    }
    if videos.is_empty() {
        let others = left_out_of(folder)?;
        let others = others.map_or_else(String::new, |others| format!(", but {others}"));
        return Err(CurateError::input(
            folder,
            format!(
                "holds no videos ({}) and no images{others}",
                VIDEO_EXTENSIONS.join(", ")
            ),
        ));
    }
    Ok(videos)
}

/// Returns a line for every folder among the paths that holds videos which [`expand_inputs`] does not take: those
/// with other extensions, and those in its subfolders.
///
/// # Errors
/// When a folder cannot be read.
pub fn left_out_of_folders(paths: &[PathBuf]) -> Result<Vec<String>, CurateError> {
    let mut lines = Vec::new();
    for folder in paths.iter().filter(|path| path.is_dir()) {
        if let Some(others) = left_out_of(folder)? {
            lines.push(format!(
                "{}: {others} are left out; name them to take them",
                folder.display()
            ));
        }
    }
    Ok(lines)
}

/// Lists the files of a folder that are not taken, in words: other extensions with their numbers, subfolders with those
/// of their videos.
fn left_out_of(folder: &Path) -> Result<Option<String>, CurateError> {
    let mut extensions = BTreeMap::new();
    let mut folders = Vec::new();
    for path in store::paths_in(folder)? {
        if is_real_folder(&path) {
            let count = videos_below(&path);
            if count > 0 {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                folders.push(format!("{count} in the folder {name}"));
            }
        } else if has_extension(&path, OTHER_VIDEO_EXTENSIONS) {
            *extensions.entry(extension(&path)).or_insert(0_usize) += 1;
        }
    }
    let extensions = extensions
        .into_iter()
        .map(|(extension, count)| format!("{count} .{extension}"));
    let words: Vec<String> = extensions.chain(folders).collect();
    Ok((!words.is_empty()).then(|| words.join(", ")))
}

/// Videos of all extensions in a folder and those below it.
fn videos_below(folder: &Path) -> usize {
    let mut count = 0;
    // A subfolder that cannot be read is nothing that was asked for.
    for path in store::paths_in(folder).unwrap_or_default() {
        if is_real_folder(&path) {
            count += videos_below(&path);
        } else if has_extension(&path, VIDEO_EXTENSIONS)
            || has_extension(&path, OTHER_VIDEO_EXTENSIONS)
        {
            count += 1;
        }
    }
    count
}

/// A folder that is no link, which may lead round in a circle, and not hidden.
fn is_real_folder(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.is_dir() && !path.is_symlink() && !name.starts_with('.')
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    extensions.contains(&extension(path).as_str())
}

/// The extension in lower case; empty for a name without one.
fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}
