//! Tracks of rigid objects: cubic Bézier curves of centres, spherical interpolation of rotations.
#![expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "tracks are checked when they are read"
)]

use glam::{DQuat, DVec3};
use omnilife_engine::{
    gaussians::tracked::TrackedObject, trajectories::rigid_path::CORRECTION_VALUES,
};
use omnilife_schemas::Similarity;
use serde::{Deserialize, Serialize};

use super::FrameTransform;

/// Share of a piece by which its ends are moved inwards, where the next piece begins.
const INWARDS: f64 = 1e-9;
/// Time in which an object with a single pose is visible.
const MOMENT_SECONDS: f64 = 1e-6;

/// An object in time; its times are seconds from the begin of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ObjectTrack {
    pub(super) id: u32,
    /// K + 1 times, increasing.
    pub(super) times: Vec<f64>,
    /// 3 K + 1 control points.
    pub(super) positions: Vec<[f64; 3]>,
    /// K + 1 quaternions (w, x, y, z).
    pub(super) rotations: Vec<[f64; 4]>,
}

/// Centre and rotation of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ObjectPose {
    pub(super) centre: DVec3,
    pub(super) rotation: DQuat,
}

pub(super) fn quaternion([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w)
}

pub(super) fn wxyz(quaternion: DQuat) -> [f64; 4] {
    [quaternion.w, quaternion.x, quaternion.y, quaternion.z]
}

impl ObjectTrack {
    pub(super) fn check(&self) -> Result<(), String> {
        let knots = self.times.len();
        let is_complete = knots >= 2
            && self.rotations.len() == knots
            && Some(self.positions.len()) == knots.checked_mul(3).and_then(|n| n.checked_sub(2));
        if !is_complete {
            return Err(format!(
                "has an object {} with {knots} times, {} positions and {} rotations",
                self.id,
                self.positions.len(),
                self.rotations.len()
            ));
        }
        let rises = self.times.windows(2).all(|pair| pair[0] < pair[1]);
        let mut numbers = self.times.iter().chain(self.positions.as_flattened());
        let mut lengths = self.rotations.iter().map(|&q| quaternion(q).length());
        let are_rotations = lengths.all(|length| (0.5..=2.0).contains(&length));
        if !rises || !are_rotations || numbers.any(|number| !number.is_finite()) {
            return Err(format!(
                "has an object {} whose times do not increase, or with numbers that are not possible",
                self.id
            ));
        }
        Ok(())
    }

    /// Returns the pose at a time; `None` before and after the track.
    pub(super) fn pose(&self, time: f64) -> Option<ObjectPose> {
        let (first, last) = (*self.times.first()?, *self.times.last()?);
        if !(first..=last).contains(&time) {
            return None;
        }
        let after = self.times.partition_point(|&knot| knot <= time);
        let piece = after.clamp(1, self.times.len() - 1) - 1;
        let (begin, end) = (self.times[piece], self.times[piece + 1]);
        let u = (time - begin) / (end - begin);
        let control = |at: usize| DVec3::from_array(self.positions[3 * piece + at]);
        let v = 1.0 - u;
        let centre = control(0) * (v * v * v)
            + control(1) * (3.0 * u * v * v)
            + control(2) * (3.0 * u * u * v)
            + control(3) * (u * u * u);
        let [from, to] = [piece, piece + 1].map(|at| quaternion(self.rotations[at]).normalize());
        Some(ObjectPose {
            centre,
            rotation: from.slerp(to, u),
        })
    }

    /// Returns the track of a model's object with its corrections, exactly: between its knots a path is cubic, and
    /// turns at one speed about one axis.
    pub(super) fn of(
        object: &TrackedObject,
        corrections: &[f32],
        placed: &FrameTransform,
        begin_seconds: f64,
    ) -> Result<Self, String> {
        let path = object.path.in_world(&Similarity::new([0.0; 3], 1.0));
        if path.centre.degree == 0 && path.centre.coefficients.len() > 1 {
            return Err(format!("object {} jumps from place to place", object.id));
        }
        let [begin, end] = object.path.range_seconds();
        let pieces = (corrections.len() / CORRECTION_VALUES).saturating_sub(1);
        let of_corrections =
            (0..=pieces).map(|knot| begin + (end - begin) * knot as f64 / pieces.max(1) as f64);
        let mut knots: Vec<f64> = (path.centre.knots.iter().copied())
            .chain(path.heading_seconds.iter().copied())
            .chain(of_corrections)
            .filter(|time| (begin..=end).contains(time))
            .collect();
        knots.sort_by(f64::total_cmp);
        // Knots that differ by rounding are one.
        knots.dedup_by(|next, knot| *next - *knot <= INWARDS * (end - begin).abs());
        if knots.len() < 2 {
            knots.push(begin + MOMENT_SECONDS);
        }
        let pose = |time: f64| -> Result<ObjectPose, String> {
            let pose = object.path.pose(time.clamp(begin, end), corrections);
            let pose = pose.ok_or_else(|| format!("object {} has no pose", object.id))?;
            Ok(ObjectPose {
                centre: placed.place(pose.centre.as_dvec3()),
                rotation: placed.turn * pose.quaternion.as_dquat(),
            })
        };
        let (mut positions, mut rotations) = (Vec::new(), Vec::new());
        for pair in knots.windows(2) {
            let length = pair[1] - pair[0];
            let at = |share: f64| pose(pair[0] + share * length);
            let [from, third, two_thirds, to] =
                [at(0.0)?, at(1.0 / 3.0)?, at(2.0 / 3.0)?, at(1.0 - INWARDS)?];
            // The cubic through four points, in control points.
            let [p, q, r, s] = [from, third, two_thirds, to].map(|pose| pose.centre);
            let early = (-5.0 * p + 18.0 * q - 9.0 * r + 2.0 * s) / 6.0;
            let late = (2.0 * p - 9.0 * q + 18.0 * r - 5.0 * s) / 6.0;
            if positions.is_empty() {
                positions.push(p.to_array());
                rotations.push(wxyz(from.rotation));
            }
            positions.extend([early, late, s].map(|point: DVec3| point.to_array()));
            rotations.push(wxyz(to.rotation));
        }
        Ok(Self {
            id: object.id,
            times: knots.iter().map(|time| time - begin_seconds).collect(),
            positions,
            rotations,
        })
    }
}
