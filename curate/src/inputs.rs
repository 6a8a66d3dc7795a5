//! Input videos of the paths on the command line.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{records::InputFile, store};

use crate::{error::CurateError, stills};

/// File name extensions of videos, in lower case.
pub const VIDEO_EXTENSIONS: &[&str] = &["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "ts"];

/// Extensions of other videos, in lower case: those of cameras and discs, which are read if named explicitly, and those
/// that makers' programs must stitch first.
const OTHER_VIDEO_EXTENSIONS: &[&str] = &[
    "360", "3gp", "asf", "dv", "f4v", "flv", "insv", "lrv", "m2t", "m2ts", "m2v", "mpeg", "mts",
    "mxf", "ogv", "qt", "vob", "wmv",
];

/// Extensions of still images, in lower case. They are taken only from a folder without videos; those other than PNG
/// and JPEG never.
const IMAGE_EXTENSIONS: &[&str] = &[
    "avif", "bmp", "dng", "exr", "heic", "heif", "insp", "jpeg", "jpg", "png", "tif", "tiff",
    "webp",
];

/// Reason why a hidden file is not taken.
const HIDDEN: &str = "a hidden file, which is taken only where it is named";

/// Replaces every folder by the visible videos directly in it, sorted by name. Files stay as they are, and so does a
/// folder of images without videos: still panoramas.
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
        .filter(|path| !store::is_hidden(path))
        .collect();
    if videos.is_empty() && stills::has_images(folder)? {
        return Ok(vec![folder.to_owned()]);
    }
    if videos.is_empty() {
        let others = left_out_of(folder, &BTreeSet::new())?;
        let others = match others.is_empty() {
            true => String::new(),
            false => format!(", but {}", in_words(&others)),
        };
        return Err(CurateError::input(
            folder,
            format!(
                "holds no videos ({}) and no PNG or JPEG images{others}",
                VIDEO_EXTENSIONS.join(", ")
            ),
        ));
    }
    Ok(videos)
}

/// Videos of folders that are not taken.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InputsLeftOut {
    /// A line for every folder that holds any.
    pub lines: Vec<String>,
    /// The files.
    pub files: Vec<InputFile>,
}

/// Returns the videos in folders among the paths that are not among `videos`, the result of [`expand_inputs`]: those
/// with other extensions, and those in subfolders.
///
/// # Errors
/// When a folder cannot be read.
pub fn left_out_of_folders(
    paths: &[PathBuf],
    videos: &[PathBuf],
) -> Result<InputsLeftOut, CurateError> {
    let taken = videos.iter().map(|video| located(video)).collect();
    let mut left_out = InputsLeftOut::default();
    for folder in paths.iter().filter(|path| path.is_dir()) {
        let files = left_out_of(folder, &taken)?;
        if !files.is_empty() {
            left_out.lines.push(format!(
                "{}: {} are left out; name them to take them",
                folder.display(),
                in_words(&files)
            ));
            left_out.files.extend(files);
        }
    }
    Ok(left_out)
}

/// Returns a canonical path of a file.
fn located(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// Returns the videos of a folder that are not among those `taken`, in order of their names.
fn left_out_of(folder: &Path, taken: &BTreeSet<PathBuf>) -> Result<Vec<InputFile>, CurateError> {
    let mut files = Vec::new();
    let is_of_stills = taken.contains(&located(folder));
    for path in store::paths_in(folder)? {
        let name = name(&path);
        if let Some(reason) = reason_of_image(&path, is_of_stills) {
            files.push(InputFile { file: name, reason });
            continue;
        }
        if is_real_folder(&path) {
            add_videos_below(&path, &name, taken, &mut files);
        } else if let Some(reason) = reason_of_video(&path)
            && !taken.contains(&located(&path))
        {
            files.push(InputFile { file: name, reason });
        }
    }
    Ok(files)
}

/// Returns why a video in a folder is not taken; `None` if it is, and for other files.
fn reason_of_video(path: &Path) -> Option<String> {
    if path.is_symlink() && path.is_dir() {
        return Some("a link to a folder, which is taken only where it is named".to_owned());
    }
    if path.is_symlink() && !path.exists() && has_extension(path, VIDEO_EXTENSIONS) {
        return Some("a link to a file that is not there".to_owned());
    }
    if has_extension(path, OTHER_VIDEO_EXTENSIONS) {
        let extension = extension(path);
        return Some(format!(
            "a .{extension} file, which is taken only where it is named"
        ));
    }
    (store::is_hidden(path) && has_extension(path, VIDEO_EXTENSIONS)).then(|| HIDDEN.to_owned())
}

/// Returns why an image in a folder is not taken; `None` if it is, and for other files.
fn reason_of_image(path: &Path, is_of_stills: bool) -> Option<String> {
    let extension = extension(path);
    if !path.is_file() || !IMAGE_EXTENSIONS.contains(&extension.as_str()) {
        return None;
    }
    match (is_of_stills, extension.as_str()) {
        (true, "jpg" | "jpeg" | "png") if store::is_hidden(path) => Some(HIDDEN.to_owned()),
        (true, "jpg" | "jpeg" | "png") => None,
        (true, _) => Some(format!("a .{extension} image, and PNG and JPEG are read")),
        (false, _) => Some("an image beside videos, which are taken".to_owned()),
    }
}

/// Adds the videos of all extensions in a folder and its subfolders, named by `place`.
fn add_videos_below(
    folder: &Path,
    place: &str,
    taken: &BTreeSet<PathBuf>,
    files: &mut Vec<InputFile>,
) {
    // An unreadable subfolder was not requested.
    for path in store::paths_in(folder).unwrap_or_default() {
        let place = format!("{place}/{}", name(&path));
        if is_real_folder(&path) {
            add_videos_below(&path, &place, taken, files);
        } else if (has_extension(&path, VIDEO_EXTENSIONS)
            || has_extension(&path, OTHER_VIDEO_EXTENSIONS))
            && !taken.contains(&located(&path))
        {
            files.push(InputFile {
                file: place,
                reason: "in a folder below the one that was given".to_owned(),
            });
        }
    }
}

/// Counts the files of a folder that are not taken by extension, and by the folder below in which they are.
fn in_words(files: &[InputFile]) -> String {
    let mut extensions = BTreeMap::new();
    let mut folders = BTreeMap::new();
    for InputFile { file, .. } in files {
        match file.split_once('/') {
            Some((folder, _)) => *folders.entry(folder).or_insert(0_usize) += 1,
            None => {
                *extensions
                    .entry(extension(Path::new(file)))
                    .or_insert(0_usize) += 1;
            }
        }
    }
    let extensions = extensions
        .into_iter()
        .map(|(extension, count)| format!("{count} .{extension}"));
    let folders = folders
        .into_iter()
        .map(|(folder, count)| format!("{count} in the folder {folder}"));
    extensions.chain(folders).collect::<Vec<_>>().join(", ")
}

fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Returns true for a visible folder that is not a link; links may lead round in a circle.
fn is_real_folder(path: &Path) -> bool {
    path.is_dir() && !path.is_symlink() && !name(path).starts_with('.')
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    extensions.contains(&extension(path).as_str())
}

/// Returns the extension in lower case; empty for a name without one.
fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}
