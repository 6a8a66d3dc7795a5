//! The ellipse of a Gaussian linearized in the image, and its VJP.

use glam::{Vec2, Vec3, vec3};

use crate::camera::{CameraKernels, LOW_PASS, PixelBox, Projection, View};
use crate::render::project::{Ellipse, cpu::Placed};

/// The intermediate values that forward and backward share.
pub(super) struct Linearization {
    pub(super) projection: Projection,
    /// Rows of `J W`, in world coordinates.
    to_u: Vec3,
    to_v: Vec3,
    /// Rows of `V = J W M`.
    v_u: Vec3,
    v_v: Vec3,
    /// `A`, `B`, `C` of the covariance.
    covariance: [f32; 3],
    determinant: f32,
}

/// Gradients of a footprint's shape by the centre (in the camera frame) and by the axes (in world
/// coordinates).
pub(super) struct ShapeGradient {
    pub(super) point: Vec3,
    pub(super) axes: [Vec3; 3],
    /// By the centre's image with the shape fixed, per pixel.
    pub(super) centre: [f32; 2],
}

impl Linearization {
    pub(super) fn new(view: &View, placed: &Placed) -> Self {
        let projection = view
            .camera
            .project_with_jacobian(placed.point, placed.distance);
        let world_from_camera = view.rotation.transpose();
        let to_u = world_from_camera * projection.jacobian_u;
        let to_v = world_from_camera * projection.jacobian_v;
        let along = |row: Vec3| {
            vec3(
                row.dot(placed.axes[0]),
                row.dot(placed.axes[1]),
                row.dot(placed.axes[2]),
            )
        };
        let (v_u, v_v) = (along(to_u), along(to_v));
        let (uu, vv) = (v_u.length_squared(), v_v.length_squared());
        Self {
            projection,
            to_u,
            to_v,
            v_u,
            v_v,
            covariance: [uu + LOW_PASS, v_u.dot(v_v), vv + LOW_PASS],
            determinant: v_u.cross(v_v).length_squared()
                + LOW_PASS * (uu + vv)
                + LOW_PASS * LOW_PASS,
        }
    }

    /// Standard deviation along the columns, pixels.
    pub(super) fn width(&self) -> f32 {
        self.covariance[0].sqrt()
    }

    pub(super) fn ellipse(&self) -> Ellipse {
        let [_, b, c] = self.covariance;
        Ellipse {
            variance: self.determinant / c,
            inverse_variance: c / self.determinant,
            slope: b / c,
            inverse_row_variance: 1.0 / c,
        }
    }

    /// The rectangle around `q <= q_max`.
    pub(super) fn bounds(&self, q_max: f32) -> PixelBox {
        PixelBox {
            centre: self.projection.pixel.to_array(),
            extent: [
                (q_max * self.covariance[0]).sqrt(),
                (q_max * self.covariance[2]).sqrt(),
            ],
        }
    }

    /// VJP of centre and [`Linearization::ellipse`]; `gradient` is that of
    /// [`super::SplatGradient::shape`].
    pub(super) fn vjp(&self, view: &View, placed: &Placed, gradient: &[f32; 10]) -> ShapeGradient {
        let [by_u, by_v, by_inverse, by_slope, by_row, ..] = *gradient;
        let ellipse = self.ellipse();
        let (slope, row) = (ellipse.slope, ellipse.inverse_row_variance);
        // variance = A - B^2/C, slope = B/C, row = 1/C.
        let by_variance = -ellipse.inverse_variance * ellipse.inverse_variance * by_inverse;
        let by_a = by_variance;
        let by_b = -2.0 * slope * by_variance + row * by_slope;
        let by_c = slope * slope * by_variance - slope * row * by_slope - row * row * by_row;
        // Sigma = V V^T + 0.3 I.
        let dv_u = 2.0 * by_a * self.v_u + by_b * self.v_v;
        let dv_v = by_b * self.v_u + 2.0 * by_c * self.v_v;
        // V = (J W) M.
        let (mut to_u, mut to_v) = (Vec3::ZERO, Vec3::ZERO);
        let mut axes = [Vec3::ZERO; 3];
        for k in 0..3 {
            to_u += dv_u[k] * placed.axes[k];
            to_v += dv_v[k] * placed.axes[k];
            axes[k] = dv_u[k] * self.to_u + dv_v[k] * self.to_v;
        }
        ShapeGradient {
            point: view.camera.project_vjp(
                placed.point,
                placed.distance,
                Vec2::new(by_u, by_v),
                view.rotation * to_u,
                view.rotation * to_v,
            ),
            axes,
            centre: [by_u, by_v],
        }
    }
}
