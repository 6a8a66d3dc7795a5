//! Which videos the paths on the command line stand for.

use std::path::{Path, PathBuf};

use omnilife_schemas::store;

use crate::error::CurateError;

/// File name extensions of videos, in lower case.
pub const VIDEO_EXTENSIONS: &[&str] = &["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "ts"];

/// Replaces every folder by the videos directly in it, sorted by name; files stay as they are.
///
/// # Errors
/// [`CurateError::Input`] for a path that does not exist and for a folder without videos.
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
        .filter(|path| path.is_file() && has_video_extension(path))
        .collect();
    if videos.is_empty() {
        return Err(CurateError::input(
            folder,
            format!("holds no videos ({})", VIDEO_EXTENSIONS.join(", ")),
        ));
    }
    Ok(videos)
}

fn has_video_extension(path: &Path) -> bool {
    path.extension()
        .and_then(|extension| extension.to_str())
        .is_some_and(|extension| {
            VIDEO_EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str())
        })
}
