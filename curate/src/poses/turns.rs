//! Poses of a rotating or hovering camera: its images show no parallax.

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{
    Pose, RgbImage,
    camera::{Camera, PinholeCamera},
    points::PointCloud,
    progress::Progress,
    records::{PoseSource, PoseValidation, Scale, Sequence, ValidationStatus},
};
use rayon::prelude::*;

use super::{
    PosedSequence,
    parallax::TURNS_PIXELS,
    planar_ground::{self, PlanarGround},
    sfm,
};
use crate::{
    error::{CurateError, SfmError},
    motion::pinhole_turns::{GreyFrame, remainder, turns},
};

/// Least share of fitting pixels at which neighbouring frames count as registered.
const GOOD_FIT: f64 = 0.8;
/// Largest shift that rotations may leave between frames over planar ground, in widths: a pixel of 640. A camera that
/// moves over flat ground by 5 % of its height in the whole clip leaves as much.
const MOST_REMAINDER: f64 = 1.0 / 640.0;
/// Measure of that shift, pixels.
const REMAINDER_MEASURE: &str = "hovering_remainder_pixels";
/// Angle of the mean camera below the horizon that the ground is assumed by.
const PITCH_MEASURE: &str = "hovering_pitch_degrees";
/// That of a camera that looks straight down.
const NADIR: f64 = 90.0;
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

/// Returns the poses of a hovering camera over planar ground if structure from motion found none, or found them without
/// parallax. `pitch` is the stated angle of the camera below the horizon, degrees. `None` if the images do not fit
/// rotations either, or the poses are sound.
///
/// Where rotations leave shifts between frames, or no frame shows ground, no ground is assumed: the result has no
/// points, and its source says why.
///
/// # Errors
/// When an image cannot be read.
pub(super) fn of_hovering(
    (folder, sequence): (&Path, &Sequence),
    found: &Result<PosedSequence, CurateError>,
    pitch: Option<f64>,
    progress: &dyn Progress,
) -> Result<Option<PosedSequence>, CurateError> {
    let Some((why, focal)) = no_parallax(found).filter(|_| sequence.is_pinhole()) else {
        return Ok(None);
    };
    progress.note(&format!(
        "{}: no parallax is found, so the frames are compared as those of a camera that hovers",
        sequence.id
    ));
    let entries = &sequence.frames.entries;
    let read = |frame: usize| -> Result<RgbImage, CurateError> {
        Ok(RgbImage::read(&folder.join(&entries[frame].file))?)
    };
    let frames: Vec<GreyFrame> = (0..entries.len())
        .into_par_iter()
        .map(|frame| {
            let image = read(frame)?;
            let open = vec![true; image.width * image.height];
            Ok(grey_frame(&image, open))
        })
        .collect::<Result<_, CurateError>>()?;
    let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
    let turns = registered(&frames, size, focal);
    if !turns.succeeded {
        return Ok(None);
    }
    let left = remainder_pixels(&frames, &turns);
    if found.is_err() && !is_planar(left, size) {
        progress.note(&format!(
            "{}: the camera does not hover over planar ground: {}",
            sequence.id,
            misfit(left, size)
        ));
        return Ok(None);
    }
    let ground = if is_planar(left, size) {
        planar_ground::below(turns.camera, &turns.poses, pitch.unwrap_or(NADIR), read)?
    } else {
        None
    };
    Ok(Some(hovering(turns, ground, (left, pitch), &why)))
}

/// Returns why poses show no parallax, and the focal length of the rotations, pixels, where it is known; `None` where
/// they are sound, or failed for another reason.
fn no_parallax(found: &Result<PosedSequence, CurateError>) -> Option<(String, Option<f64>)> {
    match found {
        Err(CurateError::Sfm(error @ (SfmError::NoPoses { .. } | SfmError::Broken { .. }))) => {
            Some((error.to_string(), None))
        }
        Ok(posed) => {
            let measures = &posed.validation.measures;
            let pixels = measures.get(sfm::TURNS_MEASURE)?;
            let why = format!("turns alone explain where points are seen, to {pixels:.2} pixels");
            let focal = measures.get(sfm::TURNS_FOCAL_MEASURE).copied();
            (*pixels <= TURNS_PIXELS).then_some((why, focal))
        }
        Err(_) => None,
    }
}

/// Returns the shifts that rotations leave between frames, pixels; `None` where too little detail tells.
fn remainder_pixels(frames: &[GreyFrame], turns: &RegisteredTurns) -> Option<f64> {
    let Camera::Pinhole(camera) = turns.camera else {
        return None;
    };
    let rotations = turns.poses.iter();
    let rotations: Vec<DQuat> = rotations
        .map(|pose| pose.as_ref().and_then(Pose::rotation).unwrap_or_default())
        .collect();
    let width = f64::from(camera.width);
    Some(width * remainder(frames, &rotations, camera.fx / width)?)
}

/// Returns the largest shift of a camera over planar ground, pixels.
fn most_remainder([width, _]: [usize; 2]) -> f64 {
    MOST_REMAINDER * width as f64
}

/// Returns true if rotations leave so little that the ground may be a plane below a camera in one place.
fn is_planar(left: Option<f64>, size: [usize; 2]) -> bool {
    left.is_some_and(|left| left <= most_remainder(size))
}

/// Returns the reason why no planar ground is assumed.
fn misfit(left: Option<f64>, size: [usize; 2]) -> String {
    match left {
        Some(left) => format!(
            "homographies of a plane leave {left:.2} pixels between frames (limit {:.2})",
            most_remainder(size)
        ),
        None => "too little detail shows to tell".to_owned(),
    }
}

/// Makes the poses of a hovering camera, over `ground` where it is known.
fn hovering(
    turns: RegisteredTurns,
    ground: Option<PlanarGround>,
    (left, pitch): (Option<f64>, Option<f64>),
    why: &str,
) -> PosedSequence {
    let size = turns.camera.size();
    let count = turns.poses.len() as u32;
    let mut measures: BTreeMap<String, f64> = BTreeMap::new();
    measures.extend(left.map(|left| (REMAINDER_MEASURE.to_owned(), left)));
    let (poses, points, reason, problem) = match ground {
        Some(ground) => {
            measures.insert(PITCH_MEASURE.to_owned(), pitch.unwrap_or(NADIR));
            let tilt = match pitch {
                Some(degrees) => format!("by a stated pitch of {degrees} degrees"),
                None => "as if the mean camera looked straight down (--camera-pitch)".to_owned(),
            };
            let fit = left.map_or_else(String::new, |left| format!(" to {left:.2} pixels"));
            let problem = format!(
                "the camera hovers: no parallax ({why}), and homographies explain the frames{fit}; its \
                 ground is assumed to be a level plane, {tilt}, at a distance of 1 (--altitude brings it to metres)"
            );
            (ground.poses, ground.points, turns.reason, problem)
        }
        None => {
            let misfit = if is_planar(left, size) {
                "no frame shows ground that is not near the horizon".to_owned()
            } else {
                misfit(left, size)
            };
            let problem = format!(
                "the camera hovers: no parallax ({why}), but no planar ground is assumed: {misfit}; what moves can be \
                 tracked, nothing can be reconstructed"
            );
            let reason = format!("{}; no planar ground: {misfit}", turns.reason);
            (turns.poses, PointCloud::default(), reason, problem)
        }
    };
    PosedSequence {
        camera: turns.camera.into(),
        masks: vec![None; poses.len()],
        poses,
        points: Some(points),
        scale: Scale::Arbitrary,
        source: PoseSource::Registered {
            reason,
            succeeded: true,
        },
        validation: PoseValidation {
            status: ValidationStatus::Unstable,
            registered_frames: count,
            total_frames: count,
            measures,
            problems: vec![problem],
        },
    }
}
