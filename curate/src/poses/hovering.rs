//! Hovering cameras: poses over planar ground, where structure from motion shows no parallax.

use std::{collections::BTreeMap, path::Path};

use glam::DQuat;
use omnilife_schemas::{
    Pose, RgbImage,
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
    turns::{RegisteredTurns, focal_pixels, grey_frame, registered, registered_finely},
};
use crate::{
    error::{CurateError, SfmError},
    motion::pinhole_turns::{GreyFrame, remainder},
};

/// Largest shift that rotations may leave between frames over planar ground, in widths: a pixel of 640. A camera that
/// moves over flat ground by 5 % of its height in the whole clip leaves as much.
const MOST_REMAINDER: f64 = 1.0 / 640.0;
/// Measure of that shift, pixels.
const REMAINDER_MEASURE: &str = "hovering_remainder_pixels";
/// Angle of the mean camera below the horizon that the ground is assumed by.
const PITCH_MEASURE: &str = "hovering_pitch_degrees";
/// That of a camera that looks straight down.
const NADIR: f64 = 90.0;
/// Reason against ground that no statement speaks for: a camera that turns in a street shows no parallax either.
const UNSTATED: &str = "the angle of the camera below the horizon is not stated (--camera-pitch; for one that looks \
                        straight down --altitude or --gsd is enough)";
/// Share of the frames below which structure from motion has failed.
const LEAST_POSED: f64 = 0.5;

/// Statement on a flight by which level ground is assumed below the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Tilt {
    /// Angle of the mean camera below the horizon, degrees.
    Pitch(f64),
    /// A size on the ground alone: the mean camera looks straight down.
    Nadir,
}

impl Tilt {
    /// Returns the tilt by a stated pitch, degrees, or else by the scale of the ground; `None` without either.
    pub(super) fn of(pitch: Option<f64>, is_scaled: bool) -> Option<Self> {
        pitch.map(Self::Pitch).or(is_scaled.then_some(Self::Nadir))
    }

    fn degrees(self) -> f64 {
        match self {
            Self::Pitch(degrees) => degrees,
            Self::Nadir => NADIR,
        }
    }
}

/// Returns the poses of a hovering camera over planar ground if structure from motion found few or none, or found them
/// without parallax. `None` if the images do not fit rotations either, or the poses are sound.
///
/// Without a tilt, where rotations leave shifts between frames, or where no frame shows ground, no ground is assumed:
/// the result has no points, and its source says why.
///
/// # Errors
/// When an image cannot be read.
pub(super) fn of_hovering(
    (folder, sequence): (&Path, &Sequence),
    found: &Result<PosedSequence, CurateError>,
    tilt: Option<Tilt>,
    progress: &dyn Progress,
) -> Result<Option<PosedSequence>, CurateError> {
    let Some(finding) = no_parallax(found).filter(|_| sequence.is_pinhole()) else {
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
    let turns = match finding.focal {
        focal @ Some(_) => registered(&frames, size, focal),
        None => registered_finely(&frames, size),
    };
    if !turns.succeeded {
        progress.note(&format!("{}: {}", sequence.id, turns.reason));
        return Ok(None);
    }
    let left = remainder_pixels(&frames, &turns);
    if !finding.is_seen && !is_planar(left, size) {
        progress.note(&format!(
            "{}: the camera does not hover over planar ground: {}",
            sequence.id,
            misfit(left, size)
        ));
        return Ok(None);
    }
    let ground = match tilt.filter(|_| is_planar(left, size)) {
        Some(tilt) => planar_ground::below(turns.camera, &turns.poses, tilt.degrees(), read)?,
        None => None,
    };
    Ok(Some(hovering(turns, ground, (left, tilt), &finding.why)))
}

/// Finding that the poses of structure from motion show no parallax.
#[derive(Debug, Clone, PartialEq)]
struct NoParallax {
    why: String,
    /// True if its own points show that the camera only turns; otherwise it failed, for whatever reason.
    is_seen: bool,
    /// Focal length of the rotations, pixels, where it is known.
    focal: Option<f64>,
}

/// Returns the finding that poses show no parallax; `None` where they are sound, or failed for a reason beside the
/// images.
fn no_parallax(found: &Result<PosedSequence, CurateError>) -> Option<NoParallax> {
    let failure = |why: String| NoParallax {
        why,
        is_seen: false,
        focal: None,
    };
    match found {
        Err(CurateError::Sfm(error @ (SfmError::NoPoses { .. } | SfmError::Broken { .. }))) => {
            Some(failure(error.to_string()))
        }
        Ok(posed) => {
            let validation = &posed.validation;
            let [count, all] = [validation.registered_frames, validation.total_frames];
            if f64::from(count) < LEAST_POSED * f64::from(all) {
                let why = format!("structure from motion poses {count} of {all} frames");
                return Some(failure(why));
            }
            let pixels = *validation.measures.get(sfm::TURNS_MEASURE)?;
            let finding = NoParallax {
                why: format!("turns alone explain where points are seen, to {pixels:.2} pixels"),
                is_seen: true,
                focal: validation.measures.get(sfm::TURNS_FOCAL_MEASURE).copied(),
            };
            (pixels <= TURNS_PIXELS).then_some(finding)
        }
        Err(_) => None,
    }
}

/// Returns the shifts that rotations leave between frames, pixels; `None` where too little detail tells.
fn remainder_pixels(frames: &[GreyFrame], turns: &RegisteredTurns) -> Option<f64> {
    let rotations = turns.poses.iter();
    let rotations: Vec<DQuat> = rotations
        .map(|pose| pose.as_ref().and_then(Pose::rotation).unwrap_or_default())
        .collect();
    let width = f64::from(turns.camera.width());
    Some(width * remainder(frames, &rotations, focal_pixels(turns.camera) / width)?)
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
            "rotations leave {left:.2} pixels between frames (limit {:.2})",
            most_remainder(size)
        ),
        None => "too little detail shows to tell".to_owned(),
    }
}

/// Makes the poses of a hovering camera, over `ground` where it is known.
fn hovering(
    turns: RegisteredTurns,
    ground: Option<PlanarGround>,
    (left, tilt): (Option<f64>, Option<Tilt>),
    why: &str,
) -> PosedSequence {
    let size = turns.camera.size();
    let count = turns.poses.len() as u32;
    let mut measures: BTreeMap<String, f64> = BTreeMap::new();
    measures.extend(left.map(|left| (REMAINDER_MEASURE.to_owned(), left)));
    let (poses, points, reason, problem) = match ground.zip(tilt) {
        Some((ground, tilt)) => {
            measures.insert(PITCH_MEASURE.to_owned(), tilt.degrees());
            let tilt = match tilt {
                Tilt::Pitch(degrees) => format!("by a stated pitch of {degrees} degrees"),
                Tilt::Nadir => {
                    "as if the mean camera looked straight down (--camera-pitch)".to_owned()
                }
            };
            let fit = left.map_or_else(String::new, |left| format!(" to {left:.2} pixels"));
            let problem = format!(
                "the camera hovers: no parallax ({why}), and rotations explain the frames{fit}; its \
                 ground is assumed to be a level plane, {tilt}, at a distance of 1 (--altitude brings it to metres)"
            );
            (ground.poses, ground.points, turns.reason, problem)
        }
        None => {
            let misfit = match tilt {
                _ if !is_planar(left, size) => misfit(left, size),
                None => UNSTATED.to_owned(),
                Some(_) => "no frame shows ground that is not near the horizon".to_owned(),
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

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use glam::{DMat3, DVec3};
    use omnilife_schemas::posed_view::PosedView;

    use super::*;
    use crate::{
        motion::pinhole_turns::flat_ground::{FOCAL, frame},
        poses::GroundScale,
    };

    const SIZE: [usize; 2] = [160, 90];
    /// Length of a vehicle at a height of 46 m.
    const VEHICLE: f64 = 4.5 / 46.0;

    /// Returns rotations from the camera to a world whose z axis points down.
    fn rotations() -> Vec<DQuat> {
        let turn = |number: u32| {
            let at = f64::from(number);
            DVec3::new(0.012 * at.sin(), 0.01 * (0.8 * at).cos(), 0.008 * at)
        };
        (0..9)
            .map(|number| DQuat::from_scaled_axis(turn(number)))
            .collect()
    }

    /// Returns the clip of a camera over ground and a roof, whose way is so many of its heights.
    fn clip(way: DVec3) -> Vec<GreyFrame> {
        let rotations = rotations();
        let frames = rotations.iter().enumerate();
        frames
            .map(|(number, &rotation)| frame(rotation, way * (number as f64 / 8.0), 0.2))
            .collect()
    }

    fn turns_of(frames: &[GreyFrame]) -> RegisteredTurns {
        registered(frames, SIZE, Some(FOCAL * SIZE[0] as f64))
    }

    fn black(_: usize) -> Result<RgbImage, CurateError> {
        Ok(RgbImage::black(SIZE[0], SIZE[1]))
    }

    #[test]
    fn a_hovering_camera_has_its_turns_and_vehicles_have_their_ways() {
        let frames = clip(DVec3::ZERO);
        let turns = turns_of(&frames);
        let left = remainder_pixels(&frames, &turns);
        assert!(turns.succeeded && is_planar(left, SIZE), "{left:?}");
        let ground = planar_ground::below(turns.camera, &turns.poses, NADIR, black);
        let ground = ground.unwrap().unwrap();
        let found: Vec<DQuat> = (ground.poses.iter().flatten())
            .map(|pose| pose.rotation().unwrap())
            .collect();
        let truth = rotations();
        for (number, (own, right)) in found.iter().zip(&truth).enumerate() {
            let error = (found[0].inverse() * *own).angle_between(truth[0].inverse() * *right);
            assert!(
                error.to_degrees() < 0.1,
                "{number}: {} degrees",
                error.to_degrees()
            );
        }
        // A vehicle goes 2.5 of its lengths along the ground, and is seen at its true place.
        let view = |to_world: DQuat| PosedView {
            frame: 0,
            seconds: 0.0,
            camera: turns.camera,
            to_world: DMat3::from_quat(to_world),
            centre: DVec3::ZERO,
        };
        let place = |number: usize, at: DVec3| {
            let pixel = view(truth[number]).pixel(at).unwrap();
            let ray = view(found[number]).ray(pixel);
            ray / ray.y
        };
        let begin = DVec3::new(-0.2, 0.1, 1.0);
        let end = begin + DVec3::new(2.5 * VEHICLE, 0.0, 0.0);
        let way = place(0, begin).distance(place(8, end));
        assert!((way - 2.5 * VEHICLE).abs() < 0.05 * VEHICLE, "{way}");
    }

    #[test]
    fn a_camera_that_moves_does_not_hover() {
        // A tenth of its height along the ground, or up, within the clip.
        for way in [0.1 * DVec3::X, 0.1 * DVec3::Y, -0.1 * DVec3::Z] {
            let frames = clip(way);
            let left = remainder_pixels(&frames, &turns_of(&frames));
            assert!(!is_planar(left, SIZE), "{way}: {left:?}");
            let misfit = misfit(left, SIZE);
            assert!(
                misfit.contains("limit 0.25") && !misfit.contains('\n'),
                "{misfit}"
            );
        }
        assert!(!is_planar(None, SIZE));
    }

    #[test]
    fn an_unknown_focal_length_is_found_between_those_of_the_grid() {
        let frames = clip(DVec3::ZERO);
        let focal = |turns: &RegisteredTurns| focal_pixels(turns.camera) / SIZE[0] as f64;
        let [coarse, fine] = [
            registered(&frames, SIZE, None),
            registered_finely(&frames, SIZE),
        ];
        assert!((focal(&coarse) - FOCAL).abs() > 0.04, "{}", focal(&coarse));
        assert!((focal(&fine) - FOCAL).abs() < 0.02, "{}", focal(&fine));
    }

    #[test]
    fn few_poses_may_be_those_of_a_hovering_camera() {
        let turns = turns_of(&clip(DVec3::ZERO));
        let of = |registered_frames: u32, pixels: Option<f64>| {
            let mut posed = hovering(turns_of(&clip(DVec3::ZERO)), None, (None, None), "");
            posed.validation.registered_frames = registered_frames;
            let measure = pixels.map(|pixels| (sfm::TURNS_MEASURE.to_owned(), pixels));
            posed.validation.measures = measure.into_iter().collect();
            no_parallax(&Ok(posed)).map(|finding| finding.is_seen)
        };
        assert_eq!(turns.poses.len(), 9);
        assert_eq!(of(4, None), Some(false));
        assert_eq!(of(9, Some(0.4)), Some(true));
        assert_eq!(of(9, Some(1.4)), None);
        assert_eq!(of(9, None), None);
    }

    #[test]
    fn without_ground_there_are_poses_and_the_reason() {
        let with = |ground: Option<PlanarGround>, left: f64, tilt: Option<Tilt>| {
            hovering(
                turns_of(&clip(DVec3::ZERO)),
                ground,
                (Some(left), tilt),
                "no points",
            )
        };
        let turns = turns_of(&clip(DVec3::ZERO));
        let ground = planar_ground::below(turns.camera, &turns.poses, NADIR, black).unwrap();
        let mut metric = with(ground.clone(), 0.1, Tilt::of(None, true));
        GroundScale::Altitude(46.0).apply(&mut metric).unwrap();
        assert_eq!(metric.scale, Scale::Metres);
        let heights = metric.points.unwrap_or_default().positions.into_iter();
        assert!(heights.map(|[_, y, _]| y).all(|y| (y - 46.0).abs() < 1e-6));
        let over_ground = with(ground, 0.1, Tilt::of(Some(90.0), false));
        assert!(
            over_ground
                .points
                .is_some_and(|points| points.len() > 10_000)
        );
        let measures = &over_ground.validation.measures;
        assert!(measures.contains_key(REMAINDER_MEASURE) && measures.contains_key(PITCH_MEASURE));
        let without = with(None, 0.9, Tilt::of(Some(90.0), false));
        assert!(without.points.is_some_and(|points| points.is_empty()));
        let PoseSource::Registered { reason, succeeded } = without.source else {
            panic!("poses of another source");
        };
        assert!(succeeded && reason.contains("0.90 pixels"), "{reason}");
        let problem = &without.validation.problems[0];
        assert!(
            problem.contains("nothing can be reconstructed"),
            "{problem}"
        );
        let unstated = with(None, 0.1, Tilt::of(None, false));
        let problem = &unstated.validation.problems[0];
        for option in ["--camera-pitch", "--altitude", "--gsd"] {
            assert!(problem.contains(option), "{problem}");
        }
        assert!(unstated.points.is_some_and(|points| points.is_empty()));
    }

    #[test]
    fn ground_is_assumed_by_a_pitch_or_a_scale_alone() {
        let degrees =
            |pitch, is_scaled| Tilt::of(pitch, is_scaled).map(|tilt: Tilt| tilt.degrees());
        assert_eq!(degrees(None, false), None);
        assert_eq!(degrees(None, true), Some(NADIR));
        assert_eq!(degrees(Some(40.0), true), Some(40.0));
        assert_eq!(degrees(Some(40.0), false), Some(40.0));
    }
}
