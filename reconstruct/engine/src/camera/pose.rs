//! A small change of a camera's pose.

use glam::{Mat3, Quat, Vec3};

use super::View;

/// What is done to a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseCorrection {
    /// World rotation about the centre, a rotation vector, radians.
    pub rotation: Vec3,
    /// Shift of the centre, normalized units.
    pub centre: Vec3,
}

impl PoseCorrection {
    /// The view after the correction.
    pub fn apply(&self, view: &View) -> View {
        View {
            // World to camera: the inverse of the rotation comes first.
            rotation: view.rotation * Mat3::from_quat(Quat::from_scaled_axis(-self.rotation)),
            centre: view.centre + self.centre,
            ..*view
        }
    }
}
