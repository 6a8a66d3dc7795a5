//! Jacobians and vector-Jacobian products (VJPs) of the camera models, in f32.
//!
//! The models themselves are defined in f64 in [`omnilife_schemas::camera`]; tests hold each file
//! here against its definition by finite differences.

pub mod erp;
pub mod pinhole;

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};
use omnilife_schemas::{
    Pose, Similarity,
    camera::{ErpCamera, PinholeCamera},
};

/// The camera models that the kernels draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// The whole sphere; columns wrap.
    Erp(ErpCamera),
    /// A perspective image.
    Pinhole(PinholeCamera),
}

/// A point's image and the two rows of the Jacobian of `(u, v)` by the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Pixels; for an ERP camera `u` is in [0, W].
    pub pixel: Vec2,
    /// `du/dp`, pixels per unit.
    pub jacobian_u: Vec3,
    /// `dv/dp`, pixels per unit.
    pub jacobian_v: Vec3,
}

impl Camera {
    /// Pixels per row.
    pub fn width(&self) -> u32 {
        match self {
            Self::Erp(camera) => camera.width,
            Self::Pinhole(camera) => camera.width,
        }
    }

    /// Rows of pixels.
    pub fn height(&self) -> u32 {
        match self {
            Self::Erp(camera) => camera.height,
            Self::Pinhole(camera) => camera.height,
        }
    }

    /// Whether the first column follows the last.
    pub fn wraps(&self) -> bool {
        matches!(self, Self::Erp(_))
    }

    /// Whether a point of the camera frame is drawn: its `distance` (radial) is beyond `near`, and
    /// for a pinhole so is its depth `z`. False for NaN.
    pub fn sees(&self, point: Vec3, distance: f32, near: f32) -> bool {
        distance > near
            && distance < f32::MAX
            && match self {
                Self::Erp(_) => true,
                Self::Pinhole(_) => point.z > near,
            }
    }

    /// Projects a point of the camera frame that [`Camera::sees`]; `distance` is `|point|`.
    pub fn project(&self, point: Vec3, distance: f32) -> Projection {
        match self {
            Self::Erp(camera) => erp::project(camera, point, distance),
            Self::Pinhole(camera) => pinhole::project(camera, point),
        }
    }

    /// VJP of [`Camera::project`]: the gradient by the point from gradients by the pixel and by the
    /// two rows of the Jacobian.
    pub fn project_vjp(
        &self,
        point: Vec3,
        distance: f32,
        pixel: Vec2,
        jacobian_u: Vec3,
        jacobian_v: Vec3,
    ) -> Vec3 {
        match self {
            Self::Erp(camera) => {
                erp::project_vjp(camera, point, distance, pixel, jacobian_u, jacobian_v)
            }
            Self::Pinhole(camera) => {
                pinhole::project_vjp(camera, point, pixel, jacobian_u, jacobian_v)
            }
        }
    }
}

impl From<ErpCamera> for Camera {
    fn from(camera: ErpCamera) -> Self {
        Self::Erp(camera)
    }
}

impl From<PinholeCamera> for Camera {
    fn from(camera: PinholeCamera) -> Self {
        Self::Pinhole(camera)
    }
}

/// A camera in a normalized scene, ready for the kernels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Image size and model.
    pub camera: Camera,
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
        camera: impl Into<Camera>,
        pose: &Pose,
        normalization: &Similarity,
        time_seconds: f64,
    ) -> Option<Self> {
        let camera_to_world = DMat3::from_quat(pose.rotation()?);
        let centre: DVec3 = normalization.normalize(pose.centre());
        centre.is_finite().then(|| Self {
            camera: camera.into(),
            rotation: camera_to_world.transpose().as_mat3(),
            centre: centre.as_vec3(),
            time_seconds,
        })
    }
}
