//! The camera of panoramas whose files alone say their size.

use std::path::Path;

use omnilife_schemas::{camera::ErpCamera, image_file::ImageFile};

use crate::{error::CurateError, exchange::ForeignFrame, poses::frame_camera::FrameCamera};

/// Reads the size of the first frame; the import compares the others with it.
///
/// # Errors
/// Without frames, with the first of the images that are not there, and where the image cannot be read.
pub(super) fn camera(
    folder: &Path,
    frames: &[ForeignFrame],
    missing_images: &[String],
) -> Result<FrameCamera, CurateError> {
    let Some(first) = frames.first() else {
        let reason = match missing_images.first() {
            Some(name) => format!("has none of the images that its poses name, such as {name}"),
            None => "has no poses".to_owned(),
        };
        return Err(CurateError::input(folder, reason));
    };
    let [width, height] = ImageFile::open(&first.image)?.shown_size()?;
    Ok(FrameCamera::Straight(
        ErpCamera {
            width: width as u32,
            height: height as u32,
        }
        .into(),
    ))
}
