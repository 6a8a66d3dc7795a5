//! Mask images of a sequence's frames: finding and resizing.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::SCENE_MASKS_FOLDER,
    plain_text,
    records::{FrameEntry, Sequence},
    rgb::Mask,
    staging::Staging,
    store,
};

use super::{ignored::IgnoredPixels, lens::Straightening};
use crate::{error::CurateError, opencv_images};

/// Radius in pixels by which masks grow before features are excluded: outlines of moving objects give features too.
const GROWTH_PIXELS: usize = 4;

/// File name extensions of mask images, in lower case.
pub(super) const EXTENSIONS: &[&str] = &["png", "jpg", "jpeg"];

/// Lists the image files of a folder, sorted.
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>, CurateError> {
    files_of(folder, EXTENSIONS)
}

/// Lists the visible files of a folder with one of these extensions (lower case), sorted.
fn files_of(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, CurateError> {
    Ok(store::paths_in(folder)?
        .into_iter()
        .filter(|path| !store::is_hidden(path))
        .filter(|path| {
            path.extension()
                .and_then(|extension| extension.to_str())
                .is_some_and(|extension| {
                    extensions.contains(&extension.to_ascii_lowercase().as_str())
                })
        })
        .collect())
}

/// Returns for every frame the file in `folder` with its name, stem or number and one of these extensions, if there is
/// one.
///
/// # Errors
/// When the folder cannot be read, or has two files for one frame.
pub(super) fn find_some(
    folder: &Path,
    frames: &[FrameEntry],
    extensions: &[&str],
) -> Result<Vec<Option<PathBuf>>, CurateError> {
    let mut by_stem: BTreeMap<OsString, PathBuf> = BTreeMap::new();
    for file in files_of(folder, extensions)? {
        if let Some(other) = by_stem.insert(frame_name(&file), file.clone()) {
            return Err(CurateError::input(
                &file,
                format!("and {} are of one frame", other.display()),
            ));
        }
    }
    let of_frame = |entry: &FrameEntry| by_stem.get(&frame_name(Path::new(&entry.file))).cloned();
    Ok(frames.iter().map(of_frame).collect())
}

/// Returns the stem of a file's name; for a number without leading zeros, so that `0007.png` belongs to frame
/// `000007.jpg`.
fn frame_name(file: &Path) -> OsString {
    let stem = file.file_stem().unwrap_or_default();
    match stem.to_str() {
        Some(number) if !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) => {
            let digits = number.trim_start_matches('0');
            OsString::from(if digits.is_empty() { "0" } else { digits })
        }
        _ => stem.to_owned(),
    }
}

/// Returns for every frame the image in `folder` with its name or stem.
///
/// # Errors
/// When the folder cannot be read, lacks the image of some frame, or has two for one.
pub(crate) fn find(folder: &Path, frames: &[FrameEntry]) -> Result<Vec<PathBuf>, CurateError> {
    let all = find_some(folder, frames, EXTENSIONS)?;
    let first_missing = all.iter().position(Option::is_none);
    let first_missing = first_missing.map_or("", |missing| frames[missing].file.as_str());
    let found: Vec<PathBuf> = all.into_iter().flatten().collect();
    if found.len() == frames.len() {
        return Ok(found);
    }
    let taken: BTreeSet<&PathBuf> = found.iter().collect();
    let files = files(folder)?;
    let other = files.iter().find(|file| !taken.contains(file));
    let other = match other.and_then(|file| file.file_name()) {
        Some(name) => format!("other files are named like {}", name.to_string_lossy()),
        None => "it has no other PNG or JPEG files".to_owned(),
    };
    Err(CurateError::input(
        folder,
        format!(
            "has images for {} of {} frames; the first without one is {first_missing} (they are \
             named like the frames); {other}",
            found.len(),
            frames.len()
        ),
    ))
}

/// Returns a line on images beside `files` (at most one per frame) that belong to no frame; `what` describes them.
///
/// # Errors
/// When the folder cannot be read.
pub(crate) fn surplus(files: &[&Path], what: &str) -> Result<Option<String>, CurateError> {
    let Some(folder) = files.iter().find_map(|file| file.parent()) else {
        return Ok(None);
    };
    let mut beside = files_of(folder, &[EXTENSIONS, &["npy"]].concat())?;
    let taken: BTreeSet<&Path> = files.iter().copied().collect();
    beside.retain(|file| !taken.contains(file.as_path()));
    let name = |file: &PathBuf| {
        let name = file.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let names: Vec<String> = beside.iter().map(name).collect();
    Ok((!names.is_empty()).then(|| {
        format!(
            "{what} left out, which are of no frame: {} ({})",
            names.len(),
            plain_text::first_of(&names)
        )
    }))
}

/// Reads masks and stages them at frame size, by nearest pixels. Returns the mask of every frame, relative to the
/// sequence's folder. A mask at its place and size already is used unchanged. A lens that is removed from the frames is
/// removed from the masks as well.
///
/// # Errors
/// When a mask cannot be read or written, or lies in the folder of staged masks without having its place and size.
pub(super) fn stage(
    staging: &mut Staging,
    sequence_folder: &Path,
    masks: &[Option<PathBuf>],
    (width, height): (usize, usize),
    straightening: Option<&Straightening>,
) -> Result<Vec<Option<String>>, CurateError> {
    let own_folder = fs::canonicalize(sequence_folder.join(SCENE_MASKS_FOLDER)).ok();
    let mut files = vec![None; masks.len()];
    for (index, source) in masks.iter().enumerate() {
        let Some(source) = source else { continue };
        let name = format!("{index:06}.png");
        let given = Mask::read(source)?;
        let mask = given.resized_to_nearest(width, height);
        let mask = straightening.map_or_else(|| mask.clone(), |straight| straight.mask(&mask));
        let file = format!("{SCENE_MASKS_FOLDER}/{name}");
        match relative_to(source, own_folder.as_deref()) {
            Some(place) if place == Path::new(&name) && mask == given => {}
            Some(_) => {
                return Err(CurateError::input(
                    source,
                    format!(
                        "lies in the folder that the sequence's own masks go to and is not named \
                         {name} or not {width}x{height} pixels; keep it elsewhere"
                    ),
                ));
            }
            None => mask.write_png(&staging.begin(&file)?)?,
        }
        files[index] = Some(file);
    }
    Ok(files)
}

/// Returns the path of a file below a folder; `None` if it lies elsewhere.
fn relative_to(file: &Path, folder: Option<&Path>) -> Option<PathBuf> {
    let path = fs::canonicalize(file).ok()?;
    path.strip_prefix(folder?).ok().map(Path::to_owned)
}

/// Writes masks as COLMAP reads them: `<image file name>.png`, black where features are ignored, grown by a few pixels.
/// Returns true if there are any.
pub(super) fn write_for_colmap(
    folder: &Path,
    moving: Option<&[PathBuf]>,
    ignored: &IgnoredPixels,
    sequence: &Sequence,
) -> Result<bool, CurateError> {
    store::create_folder(folder)?;
    let (width, height) = (sequence.frames.width, sequence.frames.height);
    let mut has_masks = false;
    for (number, entry) in sequence.frames.entries.iter().enumerate() {
        let moving = moving.map(|files| Mask::read(&files[number])).transpose()?;
        let moving = moving.map(|mask| mask.resized_to_nearest(width as usize, height as usize));
        let mask = match (moving, ignored.of_frame(number)?) {
            (Some(moving), Some(ignored)) => moving.united(&ignored),
            (Some(mask), None) | (None, Some(mask)) => mask,
            (None, None) => continue,
        };
        let name = Path::new(&entry.file)
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let path = folder.join(format!("{name}.png"));
        let grown = opencv_images::grown(&mask.data, mask.width, GROWTH_PIXELS);
        let data = grown.map_err(|error| CurateError::internal(&path, error))?;
        Mask { data, ..mask }.inverted().write_png(&path)?;
        has_masks = true;
    }
    Ok(has_masks)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    /// Either every frame has a mask, or none is used.
    #[test]
    fn masks_are_found_by_name_and_missing_ones_named() {
        let temp = tempfile::tempdir().unwrap();
        let entries: Vec<FrameEntry> = (0..3)
            .map(|index| FrameEntry {
                file: format!("frames/{index:06}.png"),
                time_seconds: f64::from(index),
                capture: None,
            })
            .collect();
        for name in ["000000.PNG", "000001.jpg", "notes.txt"] {
            fs::write(temp.path().join(name), "").unwrap();
        }
        let message = find(temp.path(), &entries).unwrap_err().to_string();
        assert!(
            message.contains("images for 2 of 3 frames") && message.contains("000002.png"),
            "{message}"
        );
        fs::write(temp.path().join("000002.Jpeg"), "").unwrap();
        let names: Vec<_> = find(temp.path(), &entries)
            .unwrap()
            .iter()
            .map(|path| path.file_name().unwrap().to_owned())
            .collect();
        assert_eq!(names, ["000000.PNG", "000001.jpg", "000002.Jpeg"]);
        fs::write(temp.path().join("000002.png"), "").unwrap();
        let message = find(temp.path(), &entries).unwrap_err().to_string();
        assert!(message.contains("of one frame"), "{message}");
    }
}
