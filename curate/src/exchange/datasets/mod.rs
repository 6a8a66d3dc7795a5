//! Layouts in which data sets of panoramas are published. They are read and not written.
//!
//! To add one: a file whose module doc gives the layout, its axes and the loader that defines it, and a line in
//! [`super::FORMATS`].
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

pub mod ob3d;
pub mod omniblender;
pub mod omniphotos;
pub mod ricoh360;
pub mod roam360;
pub mod tartanair;
mod text_file;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    image_file::ImageFile,
    store::{self, StoreError},
};

use super::{ForeignDistance, ForeignFrame, left_out};
use crate::{error::CurateError, poses::frame_camera::FrameCamera};

/// Returns the camera of full panoramas, from the first of them.
///
/// # Errors
/// For a folder without panoramas, or if the first is not twice as wide as high.
fn panorama_camera(
    folder: &Path,
    frames: &[ForeignFrame],
    missing_images: &[String],
) -> Result<FrameCamera, CurateError> {
    let first = frames.first().ok_or_else(|| {
        let reason = match missing_images.first() {
            Some(name) => format!("has none of the images that its poses name, such as {name}"),
            None => "has no poses".to_owned(),
        };
        CurateError::input(folder, reason)
    })?;
    let [width, height] = ImageFile::open(&first.image)?.shown_size()?;
    if Some(width) != height.checked_mul(2) {
        let reason =
            format!("is {width}x{height}, a panorama of the whole sphere is twice as wide as high");
        return Err(CurateError::input(&first.image, reason));
    }
    let (width, height) = (width as u32, height as u32);
    Ok(FrameCamera::Straight(ErpCamera { width, height }.into()))
}

/// Returns a frame without masks.
fn plain_frame(image: PathBuf, pose: Pose, distance: Option<ForeignDistance>) -> ForeignFrame {
    ForeignFrame {
        image,
        mask: None,
        objects: BTreeMap::new(),
        pose: Some(pose),
        distance,
        moment: None,
    }
}

/// Returns a line on the folders beside those that are read.
///
/// # Errors
/// When the folder cannot be listed.
fn folders_not_read(folder: &Path, read: &[&str]) -> Result<Option<String>, StoreError> {
    let mut names = store::names_in(folder)?;
    names.retain(|name| folder.join(name).is_dir() && !read.contains(&name.as_str()));
    names.sort();
    Ok(left_out::line(&names, "folders that are not read"))
}
