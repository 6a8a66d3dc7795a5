//! Camera poses and the similarity that normalizes a scene.

use glam::{DMat3, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where a camera is and how it is turned: `x_w = R x_c + centre`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Camera-to-world rotation as a quaternion (w, x, y, z).
    pub rotation_wxyz: [f64; 4],
    /// Camera centre in world units.
    pub centre: [f64; 3],
}

impl Pose {
    /// The pose with rotation matrix `camera_to_world` and this centre. The matrix must be a
    /// rotation to about 1e-3; it is orthonormalized.
    ///
    /// `None` for reflections, shears, scales and non-finite entries.
    pub fn from_matrix(camera_to_world: DMat3, centre: DVec3) -> Option<Self> {
        let deviation = camera_to_world * camera_to_world.transpose() - DMat3::IDENTITY;
        let largest = deviation
            .to_cols_array()
            .iter()
            .fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
        // NaN compares false, so it is refused too.
        let is_rotation = largest < 1e-3 && camera_to_world.determinant() > 0.0;
        if !is_rotation || !centre.is_finite() {
            return None;
        }
        let q = DQuat::from_mat3(&camera_to_world).normalize();
        Some(Self::new(q, centre))
    }

    /// The pose with a rotation from the camera to the world, a unit quaternion, and this centre.
    pub fn new(to_world: DQuat, centre: DVec3) -> Self {
        let DQuat { x, y, z, w } = to_world;
        Self {
            rotation_wxyz: [w, x, y, z],
            centre: centre.to_array(),
        }
    }

    /// Camera-to-world rotation. A quaternion that is not of unit length is normalized; a zero or
    /// non-finite one gives `None`.
    pub fn rotation(&self) -> Option<DQuat> {
        let [w, x, y, z] = self.rotation_wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        (length.is_finite() && length > 1e-12).then(|| q / length)
    }

    /// Camera centre in world units.
    pub fn centre(&self) -> DVec3 {
        DVec3::from_array(self.centre)
    }

    /// Whether the rotation and the centre can be used.
    pub fn is_valid(&self) -> bool {
        self.rotation().is_some() && self.centre().is_finite()
    }
}

/// `x_normalized = scale * (x_world - offset)`: recentring and scaling without rotation.
///
/// Scenes are normalized once on load, in f64, and the similarity is undone on export.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Similarity {
    /// World point that becomes the origin.
    pub offset: [f64; 3],
    /// Normalized units per world unit, positive.
    pub scale: f64,
}

impl Similarity {
    /// Recentres at the mean camera and scales so that the farthest camera is 1 unit from it.
    ///
    /// The camera radius is floored at 1e-9 of the distance of the mean camera from the world's
    /// origin (and at 1e-12), so that cameras in one place give a finite scale.
    /// `None` without cameras or with non-finite centres.
    pub fn from_cameras(centres: &[DVec3]) -> Option<Self> {
        if centres.is_empty() || centres.iter().any(|centre| !centre.is_finite()) {
            return None;
        }
        let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
        let radius = centres
            .iter()
            .map(|centre| centre.distance(mean))
            .fold(0.0, f64::max)
            .max(1e-9 * mean.length())
            .max(1e-12);
        Some(Self {
            offset: mean.to_array(),
            scale: 1.0 / radius,
        })
    }

    /// World to normalized coordinates.
    pub fn normalize(&self, world: DVec3) -> DVec3 {
        self.scale * (world - DVec3::from_array(self.offset))
    }

    /// Normalized to world coordinates.
    pub fn restore(&self, normalized: DVec3) -> DVec3 {
        normalized / self.scale + DVec3::from_array(self.offset)
    }
}
