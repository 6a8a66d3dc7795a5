//! Least-squares alignment of camera centres: Horn's quaternions (1987) with Umeyama's scale (1991).

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    absolute_orientation::{best_rotation, largest_eigenvector},
    records::PoseAlignment,
};

/// The rotation is open where the largest eigenvalue exceeds the next one by no more than this share of it. Centres on
/// a line have such a pair.
const LEAST_GAP: f64 = 1e-6;
/// Centres whose spread is below this share of their distance from the origin, or of 1, are in one place.
const LEAST_SPREAD: f64 = 1e-9;

/// `x_reference = scale * rotation * x_estimated + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Alignment {
    pub(crate) scale: f64,
    pub(crate) rotation: DQuat,
    pub(crate) offset: DVec3,
}

impl Alignment {
    /// Returns an estimated pose in the world of the reference; `None` without a rotation.
    pub(crate) fn apply(&self, pose: &Pose) -> Option<Pose> {
        let centre = self.scale * (self.rotation * pose.centre()) + self.offset;
        Some(Pose::new(self.rotation * pose.rotation()?, centre))
    }
}

/// Part of an alignment that centres alone leave open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Degeneracy {
    /// The centres are on a line: a turn about it is open.
    Line,
    /// The reference stays in one place: rotation and scale are open.
    ReferenceStands,
    /// The estimated centres are in one place, and those of the reference are not: the scale is open.
    EstimateStands,
}

/// Aligns estimated poses to those of the reference, in pairs of (estimated, reference). Where the centres leave the
/// rotation open, it is that of the cameras (their mean, Markley 2007).
///
/// Returns `None` without pairs or for poses that are not valid.
pub(crate) fn align(
    pairs: &[(Pose, Pose)],
    kind: PoseAlignment,
) -> Option<(Alignment, Option<Degeneracy>)> {
    if pairs.is_empty() || pairs.iter().any(|(a, b)| !a.is_valid() || !b.is_valid()) {
        return None;
    }
    let count = pairs.len() as f64;
    let means = [
        pairs.iter().map(|(a, _)| a.centre()).sum::<DVec3>() / count,
        pairs.iter().map(|(_, b)| b.centre()).sum::<DVec3>() / count,
    ];
    let centred: Vec<[DVec3; 2]> = (pairs.iter())
        .map(|(a, b)| [a.centre() - means[0], b.centre() - means[1]])
        .collect();
    let stands = [0, 1].map(|side| {
        let squared: f64 = centred.iter().map(|pair| pair[side].length_squared()).sum();
        (squared / count).sqrt() <= LEAST_SPREAD * means[side].length().max(1.0)
    });
    let (rotation, gap) = best_rotation(centred.iter().map(|[a, b]| (*a, *b)));
    let degeneracy = match stands {
        [_, true] => Some(Degeneracy::ReferenceStands),
        [true, false] => Some(Degeneracy::EstimateStands),
        [false, false] => (gap <= LEAST_GAP).then_some(Degeneracy::Line),
    };
    let rotation = match degeneracy {
        None => rotation,
        Some(_) => mean_turn(pairs)?,
    };
    let scale = match (kind, degeneracy) {
        (PoseAlignment::Rigid, _)
        | (_, Some(Degeneracy::ReferenceStands | Degeneracy::EstimateStands)) => 1.0,
        (PoseAlignment::Similarity, _) => {
            let along: f64 = centred.iter().map(|[a, b]| b.dot(rotation * *a)).sum();
            let spread: f64 = centred.iter().map(|[a, _]| a.length_squared()).sum();
            // A reflected line: no scale below zero.
            (along / spread).max(0.0)
        }
    };
    let alignment = Alignment {
        scale,
        rotation,
        offset: means[1] - scale * (rotation * means[0]),
    };
    Some((alignment, degeneracy))
}

/// Returns the mean of the rotations that take the estimated cameras to those of the reference.
pub(crate) fn mean_turn(pairs: &[(Pose, Pose)]) -> Option<DQuat> {
    let mut sum = [[0.0; 4]; 4];
    for (estimated, reference) in pairs {
        let turn = reference.rotation()? * estimated.rotation()?.inverse();
        let q = [turn.w, turn.x, turn.y, turn.z];
        for (row, a) in sum.iter_mut().zip(q) {
            for (entry, b) in row.iter_mut().zip(q) {
                *entry += a * b;
            }
        }
    }
    Some(largest_eigenvector(sum).0)
}
