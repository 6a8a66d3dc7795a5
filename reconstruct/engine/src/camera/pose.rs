//! A small change of a camera's pose.

use glam::{Mat3, Quat, Vec3};

use super::View;

/// Correction of a camera pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseCorrection {
    /// World rotation about the camera centre, a rotation vector in radians.
    pub rotation: Vec3,
    /// Shift of the centre, normalized units.
    pub centre: Vec3,
}

impl PoseCorrection {
    /// Returns the corrected view.
    pub fn apply(&self, view: &View) -> View {
        View {
            // World to camera: the inverse of the rotation comes first.
            rotation: view.rotation * Mat3::from_quat(Quat::from_scaled_axis(-self.rotation)),
            centre: view.centre + self.centre,
            ..*view
        }
    }
}
