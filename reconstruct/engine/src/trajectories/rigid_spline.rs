//! Rigid trajectory: given knots with trained offsets (Neural Atlas Graphs, supplement A.1; offsets of
//! rotations as in the published code, with the spline applied to the exponentials).
//!
//! ```text
//! T(t) = S(t, T0) + eta S(t, P)        R(t) = S_q(t, R0) S_q(t, { exp(eta Q_k) })        eta = 1/2
//! ```

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::{
    catmull_rom::{Knots, fit_positions},
    rotation_spline::{fit_rotations, rotation, rotation_of_vectors, rotation_of_vectors_vjp},
};

/// Weight of the offsets.
pub const OFFSET_WEIGHT: f64 = 0.5;

/// Position and orientation of a rigid body: columns of the rotation are its axes in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RigidPose {
    /// Origin of the body.
    pub centre: DVec3,
    /// Rotation from the body's coordinates to the world's.
    pub rotation: DMat3,
}

/// Gradient by a [`RigidPose`], entry by entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGradient {
    /// Gradient by the origin.
    pub centre: DVec3,
    /// Gradient by the matrix.
    pub rotation: DMat3,
}

impl Default for PoseGradient {
    fn default() -> Self {
        Self {
            centre: DVec3::ZERO,
            rotation: DMat3::ZERO,
        }
    }
}

impl PoseGradient {
    /// Adds another gradient.
    pub fn add(&mut self, other: &Self) {
        self.centre += other.centre;
        self.rotation += other.rotation;
    }

    /// Returns the gradient times a factor.
    pub fn scaled(&self, by: f64) -> Self {
        Self {
            centre: by * self.centre,
            rotation: by * self.rotation,
        }
    }
}

/// Given knots of a trajectory over [0, 1].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RigidSpline {
    /// Positions of the knots.
    pub positions: Vec<DVec3>,
    /// Rotations of the knots, as many.
    pub rotations: Vec<DQuat>,
}

impl RigidSpline {
    /// Fits a spline with `count` knots to poses at times in [0, 1].
    pub fn fitted(count: usize, samples: &[(f64, DVec3, DQuat)]) -> Self {
        let knots = Knots::unit(count.max(1));
        let positions: Vec<_> = samples.iter().map(|&(time, at, _)| (time, at)).collect();
        let rotations: Vec<_> = samples.iter().map(|&(time, _, q)| (time, q)).collect();
        Self {
            positions: fit_positions(knots, &positions),
            rotations: fit_rotations(knots, &rotations),
        }
    }

    /// Returns the number of given knots.
    pub fn count(&self) -> usize {
        self.positions.len()
    }

    /// Returns the pose at a time, without offsets.
    pub fn pose(&self, time: f64) -> RigidPose {
        let knots = Knots::unit(self.count());
        let turned = rotation(&knots, &self.rotations, time);
        RigidPose {
            centre: knots.position(&self.positions, time),
            rotation: DMat3::from_quat(turned.normalize()),
        }
    }
}

/// Trained offsets of a trajectory: of positions, and of rotations as rotation vectors, at the knots and at
/// one more knot beyond each end of [0, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct RigidOffsets {
    /// Length of an offset of 1, units of the scene.
    pub unit: f64,
    /// Offsets of positions.
    pub positions: Vec<DVec3>,
    /// Offsets of rotations, radians; as many.
    pub vectors: Vec<DVec3>,
}

impl RigidOffsets {
    /// Creates zero offsets for `inner` knots on [0, 1].
    pub fn zero(inner: usize, unit: f64) -> Self {
        let count = Knots::with_neighbours(inner).count;
        Self {
            unit,
            positions: vec![DVec3::ZERO; count],
            vectors: vec![DVec3::ZERO; count],
        }
    }

    /// Returns the knots.
    pub fn knots(&self) -> Knots {
        Knots::with_neighbours(self.positions.len() - 2)
    }

    /// Returns a pose of the given trajectory with the offsets at its time.
    pub fn applied(&self, given: &RigidPose, time: f64) -> RigidPose {
        let knots = self.knots();
        let turned = rotation_of_vectors(&knots, &self.vectors, OFFSET_WEIGHT, time);
        RigidPose {
            centre: given.centre
                + OFFSET_WEIGHT * self.unit * knots.position(&self.positions, time),
            rotation: given.rotation * DMat3::from_quat(turned.normalize()),
        }
    }

    /// Adds the gradients by positions and vectors of [`RigidOffsets::applied`] from that by the pose.
    pub fn applied_vjp(
        &self,
        given: &RigidPose,
        time: f64,
        upstream: &PoseGradient,
        [by_positions, by_vectors]: [&mut [DVec3]; 2],
    ) {
        let knots = self.knots();
        let weights = knots.weights(time);
        for (&knot, weight) in weights.knots.iter().zip(weights.weights) {
            by_positions[knot] += OFFSET_WEIGHT * self.unit * weight * upstream.centre;
        }
        let by_offset = given.rotation.transpose() * upstream.rotation;
        let vectors = &self.vectors;
        rotation_of_vectors_vjp(&knots, vectors, OFFSET_WEIGHT, time, by_offset, by_vectors);
    }
}
