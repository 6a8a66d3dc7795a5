//! Jacobians and vector-Jacobian products (VJPs) of the camera models, in f32.
//!
//! The models themselves are defined in f64 in [`omnilife_schemas::camera`]; tests hold each file
//! here against its definition by finite differences.

pub mod erp;

use glam::{DMat3, DVec3, Mat3, Vec3};
use omnilife_schemas::{Pose, Similarity, camera::ErpCamera};

/// A camera in a normalized scene, ready for the kernels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Image size and model.
    pub camera: ErpCamera,
    /// World-to-camera rotation.
    pub rotation: Mat3,
    /// Camera centre in normalized world units.
    pub centre: Vec3,
    /// Presentation timestamp in seconds.
    pub time_seconds: f64,
}

impl View {
    /// A view of the normalized scene. `None` when the pose is not usable.
    pub fn new(
        camera: ErpCamera,
        pose: &Pose,
        normalization: &Similarity,
        time_seconds: f64,
    ) -> Option<Self> {
        let camera_to_world = DMat3::from_quat(pose.rotation()?);
        let centre: DVec3 = normalization.normalize(pose.centre());
        centre.is_finite().then(|| Self {
            camera,
            rotation: camera_to_world.transpose().as_mat3(),
            centre: centre.as_vec3(),
            time_seconds,
        })
    }
}
