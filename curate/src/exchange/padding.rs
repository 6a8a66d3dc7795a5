//! Padding of images to frames of one size, for methods that require it.
//!
//! The padding is black, and ignored by masks. The camera of a perspective scene becomes that of the frame. A panorama
//! in a padded frame is not a whole sphere: only formats that state its place in the image can hold it. Readers of the
//! others would take the frame for the sphere, and its rows for other latitudes.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    RgbImage,
    camera::{Camera, ErpCamera},
    image_file::ImageFile,
    padded_frame::PaddedFrame,
    progress::Progress,
    rgb::{self, Mask},
    store,
};
use rayon::prelude::*;

use super::{ExportFrame, ExportRequest, ExportScene, Format, formats_where};
use crate::error::CurateError;

/// Folders for temporary files.
const IMAGE: &str = "image";
const MOVING: &str = "moving";
const IGNORED: &str = "ignored";

/// Returns the frame into which the images of `camera` are padded: that of the request, or of the split; `None` if they
/// stay unchanged.
///
/// # Errors
/// For invalid frame sizes or ones that contradict the split, padded cube faces, and padded panoramas in a format that
/// cannot state their place.
pub(super) fn frame(
    request: &ExportRequest<'_>,
    format: &Format,
    (camera, of_split): (&Camera, Option<PaddedFrame>),
    progress: &dyn Progress,
) -> Result<Option<PaddedFrame>, CurateError> {
    let refused = |reason: String| Err(CurateError::input(request.out, reason));
    let own_size = [camera.width(), camera.height()];
    let wanted = match request.pad_to.map(|size| PaddedFrame::fit(own_size, size)) {
        Some(Err(reason)) => return refused(reason),
        Some(Ok(frame)) => Some(frame),
        None => None,
    };
    if let (Some(wanted), Some(of_split)) = (wanted, of_split)
        && wanted != of_split
    {
        let [[width, height], [split_width, split_height]] = [wanted, of_split].map(|f| f.size());
        return refused(format!(
            "is to have frames of {width}x{height} pixels, and those of the split are {split_width}x{split_height}"
        ));
    }
    if request.cube_faces.is_some() {
        return match (wanted, of_split) {
            (Some(_), _) => refused("is to have cube faces, which are not padded".to_owned()),
            (None, Some(_)) => {
                progress.note("cube faces are not resized and padded, as the split asks for");
                Ok(None)
            }
            (None, None) => Ok(None),
        };
    }
    let Some(frame) = wanted
        .or(of_split)
        .filter(|frame| changes(*frame, own_size))
    else {
        return Ok(None);
    };
    let ([width, height], [image_width, image_height]) = (frame.size(), frame.image());
    let is_panorama = matches!(camera, Camera::Erp(_));
    if is_panorama && frame.is_padded() && !format.holds_padded_panoramas {
        return refused(format!(
            "is to have panoramas of {image_width}x{image_height} pixels in frames of {width}x{height}, which {} \
             takes for whole spheres; {} says where they lie, and frames of {image_width}x{image_height} need no \
             padding",
            format.id,
            formats_where(|format| format.holds_padded_panoramas)
        ));
    }
    let [left, top] = frame.offset();
    progress.note(&format!(
        "images are resized to {image_width}x{image_height} pixels and begin at column {left}, row {top} of frames \
         of {width}x{height}; the padding is masked"
    ));
    Ok(Some(frame))
}

/// Returns true if images of a size are changed.
fn changes(frame: PaddedFrame, own_size: [u32; 2]) -> bool {
    frame.is_padded() || frame.image() != own_size
}

/// Draws every frame into `scratch`, and returns their scene.
///
/// # Errors
/// For images of another size than the scene's, and those that cannot be read or written.
pub(super) fn padded(
    scene: &ExportScene,
    frame: PaddedFrame,
    scratch: &Path,
) -> Result<ExportScene, CurateError> {
    for kind in [IMAGE, MOVING, IGNORED] {
        store::create_folder(&scratch.join(kind))?;
    }
    let [width, height] = frame.size();
    let (camera, panorama) = match &scene.camera {
        Camera::Erp(_) => (ErpCamera { width, height }.into(), frame.is_padded()),
        Camera::Pinhole(camera) => (frame.pinhole(camera).into(), false),
    };
    let frames: Result<Vec<ExportFrame>, CurateError> = scene
        .frames
        .par_iter()
        .map(|one| in_frame(one, scene.camera.size(), frame, scratch))
        .collect();
    Ok(ExportScene {
        camera,
        panorama: panorama.then_some(frame),
        frames: frames?,
        points: scene.points.clone(),
        has_split: scene.has_split,
        is_rig: scene.is_rig,
        scale: scene.scale,
        source: None,
    })
}

fn in_frame(
    one: &ExportFrame,
    own_size: [usize; 2],
    frame: PaddedFrame,
    scratch: &Path,
) -> Result<ExportFrame, CurateError> {
    let [width, height] = frame.size().map(|side| side as usize);
    let [image_width, image_height] = frame.image().map(|side| side as usize);
    let name = format!("{}.png", super::stem(&one.name));
    let image = scratch.join(IMAGE).join(&name);
    let own = RgbImage::decode(ImageFile::open(&one.image)?.expect_size(own_size)?)?;
    // With the same resampling as scoring of ground truth.
    let resized = own.resized_by_area(image_width, image_height).to_rgb8();
    rgb::write_rgb8_png(&image, width, height, &frame.pad(&resized, 3, 0))?;
    let write =
        |mask: Option<Mask>, kind: &str, around: u8| -> Result<Option<PathBuf>, CurateError> {
            let Some(mask) = mask else {
                return Ok(None);
            };
            let file = scratch.join(kind).join(&name);
            let data = frame.pad(&mask.data, 1, around);
            Mask {
                width,
                height,
                data,
            }
            .write_png(&file)?;
            Ok(Some(file))
        };
    let moving = one.mask.as_deref().map(Mask::read).transpose()?;
    let moving = moving.map(|mask| mask.resized_to_nearest(image_width, image_height));
    let ignored = one.ignore_mask.as_deref().map(Mask::read).transpose()?;
    let ignored = ignored
        .map(|mask| mask.resized_to_any(image_width, image_height))
        .or_else(|| {
            frame.is_padded().then(|| Mask {
                width: image_width,
                height: image_height,
                data: vec![0; image_width * image_height],
            })
        });
    Ok(ExportFrame {
        mask: write(moving, MOVING, 0)?,
        ignore_mask: write(ignored, IGNORED, 255)?,
        name,
        image,
        ..one.clone()
    })
}
