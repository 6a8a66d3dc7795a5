//! Lines on files that an import does not take.

use std::{
    collections::BTreeSet,
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::IGNORE_MASKS_FOLDER,
    plain_text,
    store::{self, StoreError},
};

use super::{ForeignFrame, ForeignScene};
use crate::{error::CurateError, frame_order};

/// Extensions of images, including kinds that are not read.
const IMAGES: [&str; 11] = [
    "png", "jpg", "jpeg", "tif", "tiff", "bmp", "webp", "exr", "hdr", "avif", "heic",
];

/// Returns images beside those of a scene that are neither frames nor their masks or distances, in natural order.
///
/// # Errors
/// When a folder cannot be listed.
pub(super) fn images_beside(scene: &ForeignScene) -> Result<Vec<PathBuf>, StoreError> {
    if scene.drive.is_some() {
        // Its folders have the images of other sequences too; its reader tells what it leaves out of its own.
        return Ok(Vec::new());
    }
    let parents = scene.frames.iter().filter_map(|frame| frame.image.parent());
    let folders: BTreeSet<PathBuf> = parents
        .map(Path::to_owned)
        .chain(scene.image_folders.iter().cloned())
        .collect();
    let taken: BTreeSet<_> = scene
        .frames
        .iter()
        .flat_map(|frame| {
            let mask = frame.mask.iter().map(|mask| &mask.file);
            let distance = frame.distance.iter().map(|distance| &distance.file);
            let files = std::iter::once(&frame.image).chain(mask).chain(distance);
            files.chain(frame.objects.values())
        })
        .map(|file| place(file))
        .collect();
    let mut left = Vec::new();
    for folder in folders {
        for file in store::paths_in(&folder)? {
            if !taken.contains(&place(&file))
                && !store::is_hidden(&file)
                && !store::is_broken_link(&file)
                && frame_order::has_extension(&file, &IMAGES)
            {
                left.push(file);
            }
        }
    }
    left.sort_by(|a, b| frame_order::natural_paths(a, b));
    Ok(left)
}

/// Returns lines on images in folders beside those of the frames, of which a format reads masks or distances: folders of
/// which it reads nothing, and files of others that no frame has. Reduced copies as nerfstudio and 3DGS keep them
/// (`images_2`, `masks_4`) beside their originals are left out.
///
/// # Errors
/// When a folder cannot be listed.
pub(super) fn unread_images(
    root: &Path,
    frames: &[ForeignFrame],
) -> Result<Vec<String>, StoreError> {
    // The same file may be named in several ways.
    let same = |path: &Path| fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let images: BTreeSet<PathBuf> = frames
        .iter()
        .filter_map(|frame| frame.image.parent())
        .map(same)
        .collect();
    let read: BTreeSet<PathBuf> = frames
        .iter()
        .flat_map(|frame| {
            let mask = frame.mask.iter().map(|mask| &mask.file);
            let distance = frame.distance.iter().map(|distance| &distance.file);
            mask.chain(distance).chain(frame.objects.values())
        })
        .map(|file| same(file))
        .collect();
    let (mut folders, mut files) = (Vec::new(), Vec::new());
    for folder in store::paths_in(root)? {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let whole = same(&folder);
        let has_frames = images.iter().any(|images| images.starts_with(&whole));
        let is_copy = name.rsplit_once('_').is_some_and(|(of, factor)| {
            let original = same(&root.join(of));
            let mut used = images.iter().chain(&read);
            factor.parse::<u32>().is_ok() && used.any(|place| place.starts_with(&original))
        });
        let is_other = name.starts_with('.') || name == IGNORE_MASKS_FOLDER;
        if !folder.is_dir() || has_frames || is_copy || is_other {
            continue;
        }
        let all = images_below(&folder)?;
        let unread = all.iter().filter(|file| !read.contains(&same(file)));
        let unread: Vec<&PathBuf> = unread.collect();
        if unread.is_empty() {
            continue;
        }
        if unread.len() == all.len() {
            folders.push(format!("{name}/ with {}", all.len()));
        } else {
            let names = unread
                .iter()
                .map(|file| file.strip_prefix(root).unwrap_or(file));
            files.extend(names.map(|name| name.display().to_string()));
        }
    }
    folders.sort();
    let whole = line(
        &folders,
        "folders of images that are not read, as masks and distances are under the format's own names alone",
    );
    let single = line(&files, "masks or distances that no frame has");
    Ok(whole.into_iter().chain(single).collect())
}

/// Returns the images in a folder and below it, in natural order.
fn images_below(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut images = Vec::new();
    for folder in folders_below(folder)? {
        images.extend(store::paths_in(&folder)?);
    }
    images.retain(|file| {
        !store::is_hidden(file) && frame_order::has_extension(file, &IMAGES) && file.is_file()
    });
    images.sort_by(|a, b| frame_order::natural_paths(a, b));
    Ok(images)
}

/// Returns the names of missing images of a scene that are links whose target is missing.
pub(super) fn broken_links(scene: &ForeignScene) -> Vec<String> {
    let folders = [scene.root.clone(), scene.root.join("images")];
    let is_broken = |name: &&String| {
        let mut files = folders.iter().map(|folder| folder.join(name.as_str()));
        files.any(|file| store::is_broken_link(&file))
    };
    let missing = scene.missing_images.iter();
    missing.filter(is_broken).cloned().collect()
}

/// Refuses a scene none of whose images are there.
///
/// # Errors
/// When it has no frames, and names images.
pub(super) fn expect_images(
    folder: &Path,
    scene: &ForeignScene,
    broken_links: &[String],
) -> Result<(), CurateError> {
    let (true, [first, ..]) = (scene.frames.is_empty(), &scene.missing_images[..]) else {
        return Ok(());
    };
    let link = match broken_links.contains(first) {
        true => ", a link whose target is missing",
        false => "",
    };
    let reason = format!(
        "has none of the {} images that its poses name, such as {first}{link}",
        scene.missing_images.len()
    );
    Err(CurateError::input(folder, reason))
}

/// Returns the folder of a file, and its name there.
fn place(file: &Path) -> (Option<&Path>, Option<&OsStr>) {
    (file.parent(), file.file_name())
}

/// Returns a folder and all below it.
///
/// # Errors
/// When one cannot be listed.
pub(super) fn folders_below(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut folders = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        let inner = store::paths_in(&next)?.into_iter();
        open.extend(inner.filter(|path| path.is_dir() && !path.is_symlink()));
        folders.push(next);
    }
    Ok(folders)
}

/// Returns a line that counts things and names the first of them; `None` without any.
pub(super) fn line(names: &[String], what: &str) -> Option<String> {
    (!names.is_empty())
        .then(|| format!("{what}: {} ({})", names.len(), plain_text::first_of(names)))
}

/// Returns a line on lists of images for training and testing beside a scene whose format does not read them.
pub(super) fn unread_lists(scene: &ForeignScene) -> Option<String> {
    let lists = ["train.txt", "test.txt"].map(|name| scene.root.join(name));
    let are_there = lists.iter().any(|list| list.is_file());
    (are_there && scene.published_split.is_none())
        .then(|| "train.txt and test.txt are not read: the scene has no published split".to_owned())
}
