//! Jacobians and vector-Jacobian products (VJPs) of the camera models, in f32.
//!
//! The models themselves are defined in f64 in [`omnilife_schemas::camera`]. Tests compare each file here
//! with its definition by finite differences.

pub mod erp;
pub(crate) mod lanes;
pub mod nearest;
pub mod pinhole;
pub mod pose;
pub mod rays;

use std::f32::consts::{PI, TAU};

use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8, prelude::*};
use glam::{DMat3, DVec3, Mat3, Vec2, Vec3, vec3};
pub use omnilife_schemas::camera::Camera;
use omnilife_schemas::{Pose, Similarity};

use crate::camera::lanes::{LANES, Vec3x8};

/// Added to the diagonal of the projected covariance, square pixels (3DGS `forward.cu`).
pub const LOW_PASS: f32 = 0.3;
/// `cos(85 degrees)`. Nearer to a pole of an ERP image than this (`hypot(x, z) < CONE_RHO d`) the linearized
/// ellipse is meaningless, and the footprint is a cone.
pub const CONE_RHO: f32 = 0.087_155_744;
/// Largest standard deviation of an ellipse along the columns of an ERP image, as a share of the width (six
/// of them cover a quarter turn). A wider footprint is a cone.
pub const CONE_WIDTH: f32 = 1.0 / 24.0;

/// The two rows of the Jacobian of `(u, v)` with respect to a point, for 8 points.
#[derive(Clone, Copy)]
pub(crate) struct Jacobian<S: Simd> {
    /// `du/dp`, pixels per unit.
    pub(crate) u: Vec3x8<S>,
    /// `dv/dp`, pixels per unit.
    pub(crate) v: Vec3x8<S>,
}

/// Camera functions for the kernels, in f32.
pub trait CameraKernels {
    /// Returns true if a point of the camera frame is drawn: its `distance` (radial) is beyond `near`, and
    /// for a pinhole so is its depth `z`. False for NaN.
    fn sees(&self, point: Vec3, distance: f32, near: f32) -> bool;

    /// Returns the image of a direction that the camera sees, pixels; for an ERP camera `u` is in [0, W].
    fn pixel(&self, n: Vec3) -> Vec2;

    /// Returns the rows of the Jacobian of [`CameraKernels::pixel`] at a visible point of the camera frame,
    /// pixels per unit.
    fn pixel_jacobian(&self, point: Vec3) -> [Vec3; 2];

    /// Returns the column and row of the pixel that shows a point of the camera frame at `distance`; `None`
    /// for a point outside the image.
    fn pixel_of(&self, point: Vec3, distance: f32) -> Option<[usize; 2]>;

    /// Returns the angle that a pixel at the image centre subtends, radians: by its height for an ERP camera,
    /// by the geometric mean of its sides for a pinhole.
    fn pixel_radians(&self) -> f32;

    /// Returns the squared standard deviation of the low-pass filter as an angle, radians squared: the
    /// [`LOW_PASS`] of a pixel at the image centre.
    fn angular_low_pass(&self) -> f32;

    /// Returns the derivatives of a unit direction by its image: `dn/du` and `dn/dv`, radians per pixel.
    /// Within [`CONE_RHO`] of a pole of an ERP image, `dn/du` stops shrinking.
    fn pixel_step(&self, n: Vec3) -> [Vec3; 2];

    /// Returns a rectangle around the cap of `radius` radians around the unit direction `n`, whose image is
    /// `pixel`. NaN gives [`PixelBox::EVERYTHING`].
    fn cap_box(&self, n: Vec3, pixel: Vec2, radius: f32) -> PixelBox;
}

impl CameraKernels for Camera {
    fn sees(&self, point: Vec3, distance: f32, near: f32) -> bool {
        distance > near
            && distance < f32::MAX
            && match self {
                Self::Erp(_) => true,
                Self::Pinhole(_) => point.z > near,
            }
    }

    fn pixel(&self, n: Vec3) -> Vec2 {
        match self {
            Self::Erp(camera) => erp::pixel(camera, n),
            Self::Pinhole(camera) => pinhole::pixel(camera, n),
        }
    }

    fn pixel_jacobian(&self, point: Vec3) -> [Vec3; 2] {
        dispatch!(Level::new(), simd => {
            let inverse_distance = f32x8::splat(simd, 1.0 / point.length());
            let point = Vec3x8::gather(simd, &[point.to_array(); LANES]);
            let jacobian = self.jacobians(point, inverse_distance);
            [jacobian.u.lane(0), jacobian.v.lane(0)]
        })
    }

    fn pixel_of(&self, point: Vec3, distance: f32) -> Option<[usize; 2]> {
        if !self.sees(point, distance, 0.0) {
            return None;
        }
        let pixel = self.pixel(point);
        let [width, height] = self.size();
        match self {
            // The image's far edges belong to the last column and row.
            Self::Erp(_) => Some([
                (pixel.x as usize).min(width - 1),
                (pixel.y as usize).min(height - 1),
            ]),
            Self::Pinhole(_) => {
                let (x, y) = (pixel.x.floor(), pixel.y.floor());
                let is_inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
                is_inside.then_some([x as usize, y as usize])
            }
        }
    }

    fn pixel_radians(&self) -> f32 {
        match self {
            Self::Erp(camera) => PI / camera.height as f32,
            Self::Pinhole(camera) => (camera.fx * camera.fy).sqrt().recip() as f32,
        }
    }

    fn angular_low_pass(&self) -> f32 {
        match self {
            Self::Erp(camera) => LOW_PASS * (PI / camera.height as f32).powi(2),
            Self::Pinhole(camera) => LOW_PASS / (camera.fx * camera.fy) as f32,
        }
    }

    fn pixel_step(&self, n: Vec3) -> [Vec3; 2] {
        match self {
            Self::Erp(camera) => {
                let [east, down] = tangent_frame(n);
                let rho = horizontal(n).max(CONE_RHO);
                [
                    east * (rho * TAU / camera.width as f32),
                    down * (PI / camera.height as f32),
                ]
            }
            Self::Pinhole(camera) => [
                (Vec3::X - n * n.x) * (n.z / camera.fx as f32),
                (Vec3::Y - n * n.y) * (n.z / camera.fy as f32),
            ],
        }
    }

    fn cap_box(&self, n: Vec3, pixel: Vec2, radius: f32) -> PixelBox {
        let is_less_than_half = radius < 0.5 * PI;
        if !is_less_than_half {
            return PixelBox::EVERYTHING;
        }
        let (sin, pixel) = (radius.sin(), pixel.to_array());
        match self {
            Self::Erp(camera) => {
                let rho = horizontal(n);
                let half_height = radius / PI * camera.height as f32;
                // Widest point of a cap without a pole; a cap with a pole covers every column.
                let half_width = if sin < rho {
                    (sin / rho).asin() / TAU * camera.width as f32
                } else {
                    PixelBox::EVERYTHING.extent[0]
                };
                PixelBox {
                    centre: pixel,
                    extent: [half_width, half_height],
                }
            }
            Self::Pinhole(camera) => {
                let (Some(columns), Some(rows)) =
                    (slopes_of_cap(n.x, n.z, sin), slopes_of_cap(n.y, n.z, sin))
                else {
                    return PixelBox::EVERYTHING;
                };
                let pixels = |slopes: (f32, f32), focal: f64, centre: f64| {
                    let (focal, centre) = (focal as f32, centre as f32);
                    (
                        0.5 * (slopes.0 + slopes.1) * focal + centre,
                        0.5 * (slopes.1 - slopes.0) * focal,
                    )
                };
                let (u, half_width) = pixels(columns, camera.fx, camera.cx);
                let (v, half_height) = pixels(rows, camera.fy, camera.cy);
                PixelBox {
                    centre: [u, v],
                    extent: [half_width, half_height],
                }
            }
        }
    }
}

/// Camera functions for the projection, for 8 points at once.
pub(crate) trait CameraLanes {
    /// Computes [`CameraKernels::sees`] for 8 points.
    fn see<S: Simd>(&self, point: Vec3x8<S>, distance: f32x8<S>, near: f32) -> mask32x8<S>;

    /// Returns the images of directions that the camera sees, pixels.
    fn pixels<S: Simd>(&self, n: Vec3x8<S>) -> [f32x8<S>; 2];

    /// Returns the Jacobian of [`CameraLanes::pixels`].
    fn jacobians<S: Simd>(&self, point: Vec3x8<S>, inverse_distance: f32x8<S>) -> Jacobian<S>;

    /// Returns the VJP of [`CameraLanes::pixels`] and [`CameraLanes::jacobians`]: the gradient by the points
    /// from gradients by the pixels and by the two rows of the Jacobian.
    fn vjp<S: Simd>(
        &self,
        point: Vec3x8<S>,
        inverse_distance: f32x8<S>,
        pixel: [f32x8<S>; 2],
        by: &Jacobian<S>,
    ) -> Vec3x8<S>;
}

impl CameraLanes for Camera {
    #[inline(always)]
    fn see<S: Simd>(&self, point: Vec3x8<S>, distance: f32x8<S>, near: f32) -> mask32x8<S> {
        let is_beyond = distance.simd_gt(near) & distance.simd_lt(f32::MAX);
        match self {
            Self::Erp(_) => is_beyond,
            Self::Pinhole(_) => is_beyond & point.z.simd_gt(near),
        }
    }

    #[inline(always)]
    fn pixels<S: Simd>(&self, n: Vec3x8<S>) -> [f32x8<S>; 2] {
        match self {
            Self::Erp(camera) => erp::pixels(camera, n),
            Self::Pinhole(camera) => pinhole::pixels(camera, n),
        }
    }

    #[inline(always)]
    fn jacobians<S: Simd>(&self, point: Vec3x8<S>, inverse_distance: f32x8<S>) -> Jacobian<S> {
        match self {
            Self::Erp(camera) => erp::jacobian(camera, point, inverse_distance),
            Self::Pinhole(camera) => pinhole::jacobian(camera, point),
        }
    }

    #[inline(always)]
    fn vjp<S: Simd>(
        &self,
        point: Vec3x8<S>,
        inverse_distance: f32x8<S>,
        pixel: [f32x8<S>; 2],
        by: &Jacobian<S>,
    ) -> Vec3x8<S> {
        match self {
            Self::Erp(camera) => erp::vjp(camera, point, inverse_distance, pixel, by),
            Self::Pinhole(camera) => pinhole::vjp(camera, point, pixel, by),
        }
    }
}

/// Returns the distance from the vertical axis. Squares neither overflow nor vanish in the range of distances
/// used here, so that `hypot`, several times slower, is not needed.
pub fn horizontal(point: Vec3) -> f32 {
    (point.x * point.x + point.z * point.z).sqrt()
}

/// Returns two directions orthogonal to the unit direction `n` and to each other, `[e_1, e_2]` with
/// `e_1 x e_2 = n`: `e_1` is horizontal (towards growing longitude), `e_2` points down.
pub fn tangent_frame(n: Vec3) -> [Vec3; 2] {
    let rho = horizontal(n);
    // At a pole longitude is arbitrary: `atan2(0, 0)` is 0, and so is this frame's.
    let (sin, cos) = if rho > 0.0 {
        (n.x / rho, n.z / rho)
    } else {
        (0.0, 1.0)
    };
    [vec3(cos, 0.0, -sin), vec3(-n.y * sin, rho, -n.y * cos)]
}

/// Rectangle of the image in pixels; columns of an ERP image continue past both edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelBox {
    /// Centre.
    pub centre: [f32; 2],
    /// Half width and half height.
    pub extent: [f32; 2],
}

impl PixelBox {
    /// Larger than any image.
    pub const EVERYTHING: Self = Self {
        centre: [0.0; 2],
        extent: [1e9; 2],
    };
}

/// Returns the range of `x / z` over a cap around a unit direction with the coordinates `x`, `z`. It follows
/// from the planes through the centre tangent to the cap: `(x - u z)^2 = (1 + u^2) sin^2`. `None` if the cap
/// reaches `z = 0`.
fn slopes_of_cap(x: f32, z: f32, sin: f32) -> Option<(f32, f32)> {
    let denominator = z * z - sin * sin;
    if z <= 0.0 || denominator <= 0.0 {
        return None;
    }
    let root = sin * (x * x + denominator).max(0.0).sqrt();
    Some(((x * z - root) / denominator, (x * z + root) / denominator))
}

/// Camera in a normalized scene, ready for the kernels.
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
    /// Creates a view of the normalized scene. `None` for a pose that is not usable.
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
