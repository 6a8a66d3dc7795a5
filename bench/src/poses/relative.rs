//! Errors of motions from one frame to another.

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    pose::angle_between,
    records::{PoseAuc, PoseDrift, RelativePoseError},
};

/// Thresholds of the areas, degrees.
const THRESHOLDS_DEGREES: [f64; 3] = [0.5, 1.0, 5.0];
/// Frames at most whose pairs are compared; more are thinned evenly.
const MOST_PAIRED_FRAMES: usize = 2000;
/// True baselines below this share of the path have no direction.
const LEAST_BASELINE_SHARE: f64 = 1e-6;
/// Error of a pair in which a pose is missing, degrees.
const MISSING_DEGREES: f64 = 180.0;
/// Lengths of the parts along which drift is measured, as shares of the path.
const PART_SHARES: [f64; 4] = [0.1, 0.25, 0.5, 1.0];
/// Rounding of a path that is as long as a part.
const LENGTH_ROUNDING: f64 = 1e-9;

/// A frame with its reference pose and the estimated one, aligned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FramePoses {
    pub(super) seconds: f64,
    pub(super) reference: Pose,
    pub(super) estimated: Option<Pose>,
}

/// Returns the motion from a camera to another in the frame of the first: rotation and translation.
pub(super) fn motion(from: &Pose, to: &Pose) -> Option<(DQuat, DVec3)> {
    let back = from.rotation()?.inverse();
    Some((back * to.rotation()?, back * (to.centre() - from.centre())))
}

/// Returns the errors of a motion: angle in degrees, and length of the difference of the translations.
fn motion_error(reference: [&Pose; 2], estimated: [&Pose; 2]) -> Option<(f64, f64)> {
    let (true_turn, true_step) = motion(reference[0], reference[1])?;
    let (turn, step) = motion(estimated[0], estimated[1])?;
    let degrees = angle_between(true_turn, turn).to_degrees();
    Some((degrees, true_step.distance(step)))
}

pub(super) fn neighbours(frames: &[FramePoses]) -> Option<RelativePoseError> {
    let errors: Vec<(f64, f64)> = frames
        .windows(2)
        .filter_map(|pair| {
            let estimated = [pair[0].estimated.as_ref()?, pair[1].estimated.as_ref()?];
            motion_error([&pair[0].reference, &pair[1].reference], estimated)
        })
        .collect();
    let root_mean = |value: fn(&(f64, f64)) -> f64| {
        let squared: f64 = errors.iter().map(|error| value(error).powi(2)).sum();
        (squared / errors.len() as f64).sqrt()
    };
    (!errors.is_empty()).then(|| RelativePoseError {
        pairs: errors.len() as u32,
        rotation_rmse_degrees: root_mean(|error| error.0),
        translation_rmse: root_mean(|error| error.1),
    })
}

/// Returns the areas under the curves of pairwise errors.
///
/// The error of a pair is the larger one of two angles: that of the relative rotation, and that between the directions
/// of the relative translations. A pair with a missing pose has an error of 180 degrees. The area is exact, the mean of
/// `max(0, 1 - error / threshold)`; sums over histograms of whole degrees approximate it.
pub(super) fn areas(frames: &[FramePoses], path_length: f64) -> Vec<PoseAuc> {
    let stride = frames.len().div_ceil(MOST_PAIRED_FRAMES).max(1);
    let frames: Vec<&FramePoses> = frames.iter().step_by(stride).collect();
    let least_baseline = least_baseline(path_length);
    let mut sums = [0.0; THRESHOLDS_DEGREES.len()];
    let mut pairs = 0_u64;
    for (index, from) in frames.iter().enumerate() {
        for to in &frames[index + 1..] {
            let error = pair_error(from, to, least_baseline).unwrap_or(MISSING_DEGREES);
            pairs += 1;
            for (sum, threshold) in sums.iter_mut().zip(THRESHOLDS_DEGREES) {
                *sum += (1.0 - error / threshold).max(0.0);
            }
        }
    }
    let area = |(degrees, sum): (f64, f64)| PoseAuc {
        degrees,
        auc: sum / pairs.max(1) as f64,
    };
    THRESHOLDS_DEGREES.into_iter().zip(sums).map(area).collect()
}

/// Returns the error of a pair, degrees; `None` where a pose is missing.
fn pair_error(from: &FramePoses, to: &FramePoses, least_baseline: f64) -> Option<f64> {
    let reference = motion(&from.reference, &to.reference)?;
    let estimated = motion(from.estimated.as_ref()?, to.estimated.as_ref()?)?;
    Some(motion_degrees(reference, estimated, least_baseline))
}

/// Returns the length up to which a true translation has no direction.
pub(super) fn least_baseline(path_length: f64) -> f64 {
    LEAST_BASELINE_SHARE * path_length
}

/// Returns the error of a motion in degrees: the larger one of the angle of the rotations and that between the
/// directions of the translations, which the true one has above `least_baseline`.
pub(super) fn motion_degrees(
    (true_turn, true_step): (DQuat, DVec3),
    (turn, step): (DQuat, DVec3),
    least_baseline: f64,
) -> f64 {
    let of_turn = angle_between(true_turn, turn).to_degrees();
    if true_step.length() <= least_baseline {
        return of_turn;
    }
    if step == DVec3::ZERO {
        return MISSING_DEGREES;
    }
    let of_step = true_step.cross(step).length().atan2(true_step.dot(step));
    of_turn.max(of_step.to_degrees())
}

/// Returns the errors along parts of the path (the odometry errors of KITTI, Geiger et al. 2012, by shares of the path):
/// from every registered frame to the first one that is a part's length farther along the reference.
pub(super) fn drift(frames: &[FramePoses], path_length: f64) -> Vec<PoseDrift> {
    let registered: Vec<(&FramePoses, Pose)> = frames
        .iter()
        .filter_map(|frame| Some((frame, frame.estimated?)))
        .collect();
    let mut travelled = vec![0.0];
    for pair in registered.windows(2) {
        let step = pair[0]
            .0
            .reference
            .centre()
            .distance(pair[1].0.reference.centre());
        travelled.push(travelled[travelled.len() - 1] + step);
    }
    let mut rows = Vec::new();
    for path_share in PART_SHARES {
        let length = path_share * path_length;
        let mut sums = [0.0; 3];
        let mut parts = 0_u32;
        for (index, (from, estimated)) in registered.iter().enumerate() {
            let end = travelled[index] + length * (1.0 - LENGTH_ROUNDING);
            let Some((to, estimated_to)) =
                registered.get(travelled.partition_point(|&length| length < end))
            else {
                break;
            };
            let error = motion_error([&from.reference, &to.reference], [estimated, estimated_to]);
            if let Some((degrees, distance)) = error {
                parts += 1;
                let values = [to.seconds - from.seconds, distance / length, degrees];
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum += value;
                }
            }
        }
        if parts > 0 {
            let [seconds, translation_share, rotation_degrees] =
                sums.map(|sum| sum / f64::from(parts));
            rows.push(PoseDrift {
                path_share,
                seconds,
                parts,
                translation_share,
                rotation_degrees,
            });
        }
    }
    rows
}
