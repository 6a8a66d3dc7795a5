//! Poses of a rotating or hovering camera: its images show no parallax.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{
    Pose, RgbImage,
    camera::{Camera, PinholeCamera},
    points::PointCloud,
    progress::Progress,
    records::{PoseSource, PoseValidation, Scale, Sequence, ValidationStatus},
};
use rayon::prelude::*;

use super::{PosedSequence, parallax::TURNS_PIXELS, sfm};
use crate::{
    error::{CurateError, SfmError},
    motion::pinhole_turns::{GreyFrame, turns},
};

/// Least share of fitting pixels at which neighbouring frames count as registered.
const GOOD_FIT: f64 = 0.8;
/// A path of the image's middle below this is static, pixels.
const STILL: f64 = 2.0;

/// The rotations of a clip as poses.
pub(crate) struct RegisteredTurns {
    /// With square pixels and a centred principal point.
    pub(crate) camera: Camera,
    /// One per frame, all in one place.
    pub(crate) poses: Vec<Option<Pose>>,
    /// Result and quality of the fit.
    pub(crate) reason: String,
    /// True if enough of the images fits everywhere.
    pub(crate) succeeded: bool,
}

/// Returns a pinhole with square pixels and a centred principal point; the focal length is in pixels.
pub(crate) fn pinhole([width, height]: [usize; 2], focal: f64) -> Camera {
    PinholeCamera {
        width: width as u32,
        height: height as u32,
        fx: focal,
        fy: focal,
        cx: 0.5 * width as f64,
        cy: 0.5 * height as f64,
    }
    .into()
}

/// Returns luma of [0, 255] with the usable pixels.
pub(crate) fn grey_frame(image: &RgbImage, open: Vec<bool>) -> GreyFrame {
    let pixels = image.data.as_chunks::<3>().0.iter();
    GreyFrame {
        width: image.width,
        height: image.height,
        luma: pixels
            .map(|[r, g, b]| 255.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b))
            .collect(),
        open,
    }
}

/// Estimates the rotations of a camera in place, from frames of one size; its focal length is in pixels, if known.
pub(crate) fn registered(
    frames: &[GreyFrame],
    size: [usize; 2],
    focal: Option<f64>,
) -> RegisteredTurns {
    let width = size[0] as f64;
    let found = turns(frames, focal.map(|focal| focal / width));
    let pixels = found.path * width;
    let succeeded = found.least_fit >= GOOD_FIT;
    let is_still = succeeded && pixels < STILL;
    let fit = format!(
        "at least {:.0} % of the pixels fit ({:.0} % expected)",
        100.0 * found.least_fit,
        100.0 * GOOD_FIT
    );
    let lens = match focal {
        Some(_) => "a given focal length".to_owned(),
        None => format!(
            "a focal length of {:.2} widths, the best of a grid",
            found.focal
        ),
    };
    let path = format!("the image's middle moves by {pixels:.1} pixels in all");
    let reason = match (succeeded, is_still) {
        (false, _) => format!("turns of uncertain registration, {lens}: {fit}; {path}"),
        (true, true) => format!("a still camera, {lens}: {fit}; {path}"),
        (true, false) => format!("turns, {lens}: {fit}; {path}"),
    };
    let poses = found.rotations.iter().map(|&rotation| {
        let rotation = if is_still { DQuat::IDENTITY } else { rotation };
        Pose::from_matrix(DMat3::from_quat(rotation), DVec3::ZERO)
    });
    RegisteredTurns {
        camera: pinhole(size, found.focal * width),
        poses: poses.collect(),
        reason,
        succeeded,
    }
}

/// Returns the poses of a hovering camera if structure from motion found none, or found them without parallax. `None`
/// if the images do not fit rotations either, or the poses are sound.
pub(super) fn of_hovering(
    folder: &Path,
    sequence: &Sequence,
    found: &Result<PosedSequence, CurateError>,
    progress: &dyn Progress,
) -> Result<Option<PosedSequence>, CurateError> {
    let mut focal = None;
    let why = match found {
        Err(CurateError::Sfm(error @ (SfmError::NoPoses { .. } | SfmError::Broken { .. }))) => {
            error.to_string()
        }
        Ok(posed) => {
            let measures = &posed.validation.measures;
            focal = measures.get(sfm::TURNS_FOCAL_MEASURE).copied();
            match measures.get(sfm::TURNS_MEASURE) {
                Some(&pixels) if pixels <= TURNS_PIXELS => {
                    format!("turns alone explain where points are seen, to {pixels:.2} pixels")
                }
                _ => return Ok(None),
            }
        }
        Err(_) => return Ok(None),
    };
    if !sequence.is_pinhole() {
        return Ok(None);
    }
    progress.note(&format!(
        "{}: no parallax is found, so the frames are compared as those of a camera that hovers",
        sequence.id
    ));
    let entries = &sequence.frames.entries;
    let frames: Vec<GreyFrame> = entries
        .par_iter()
        .map(|entry| {
            let image = RgbImage::read(&folder.join(&entry.file))?;
            let open = vec![true; image.width * image.height];
            Ok(grey_frame(&image, open))
        })
        .collect::<Result<_, CurateError>>()?;
    let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
    let turns = registered(&frames, size, focal);
    if !turns.succeeded {
        return Ok(None);
    }
    let problem = format!(
        "the camera hovers: no parallax ({why}), and homographies explain the frames; what moves can be tracked, \
         nothing can be reconstructed"
    );
    let count = turns.poses.len() as u32;
    Ok(Some(PosedSequence {
        camera: turns.camera.into(),
        masks: vec![None; turns.poses.len()],
        poses: turns.poses,
        points: Some(PointCloud::default()),
        scale: Scale::Arbitrary,
        source: PoseSource::Registered {
            reason: turns.reason,
            succeeded: true,
        },
        validation: PoseValidation {
            status: ValidationStatus::Unstable,
            registered_frames: count,
            total_frames: count,
            measures: [].into(),
            problems: vec![problem],
        },
    }))
}
