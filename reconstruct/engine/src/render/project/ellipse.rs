//! Ellipses of 8 Gaussians linearized in the image, and their VJP.

use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;

use crate::camera::{
    CameraLanes, Jacobian, LOW_PASS, View,
    lanes::{LANES, Vec3x8},
};
use crate::render::project::{Ellipse, place::CameraGaussians8};

/// Intermediate values shared by forward and backward.
pub(super) struct Linearization<S: Simd> {
    /// Rows of `J W`, in world coordinates.
    to_u: Vec3x8<S>,
    to_v: Vec3x8<S>,
    /// Rows of `V = J W M`.
    v_u: Vec3x8<S>,
    v_v: Vec3x8<S>,
    /// `A`, `B`, `C` of the covariance.
    pub(super) covariance: [f32x8<S>; 3],
    pub(super) determinant: f32x8<S>,
}

/// Gradients of a footprint's shape by the centre (in the camera frame) and by the axes (in world
/// coordinates).
pub(super) struct ShapeGradient {
    pub(super) point: Vec3,
    pub(super) axes: [Vec3; 3],
    /// Gradient by the centre's image with the shape fixed, per pixel.
    pub(super) centre: [f32; 2],
}

impl<S: Simd> Linearization<S> {
    #[inline(always)]
    pub(super) fn new(view: &View, placed: &CameraGaussians8<S>) -> Self {
        let jacobian = view.camera.jacobians(placed.point, placed.inverse_distance);
        let world_from_camera = view.rotation.transpose();
        let to_u = jacobian.u.transformed(&world_from_camera);
        let to_v = jacobian.v.transformed(&world_from_camera);
        let along = |row: Vec3x8<S>| Vec3x8 {
            x: row.dot(placed.axes[0]),
            y: row.dot(placed.axes[1]),
            z: row.dot(placed.axes[2]),
        };
        let (v_u, v_v) = (along(to_u), along(to_v));
        let (uu, vv) = (v_u.length_squared(), v_v.length_squared());
        Self {
            to_u,
            to_v,
            v_u,
            v_v,
            covariance: [uu + LOW_PASS, v_u.dot(v_v), vv + LOW_PASS],
            determinant: v_u.cross(v_v).length_squared()
                + (uu + vv) * LOW_PASS
                + LOW_PASS * LOW_PASS,
        }
    }

    /// Returns true if the standard deviation along the columns is more than `width` pixels.
    #[inline(always)]
    pub(super) fn is_wider(&self, width: f32) -> mask32x8<S> {
        self.covariance[0].simd_gt(width * width)
    }

    /// Returns the shapes, one per lane, and a mask of the finite ones.
    #[inline(always)]
    pub(super) fn ellipses(&self) -> ([Ellipse; LANES], mask32x8<S>) {
        let [_, b, c] = self.covariance;
        let one = f32x8::splat(c.simd, 1.0);
        let (variance, inverse_variance) = (self.determinant / c, c / self.determinant);
        let inverse_row_variance = one / c;
        let slope = b * inverse_row_variance;
        let is_finite = (variance + slope + inverse_variance)
            .abs()
            .simd_lt(f32::INFINITY);
        let ellipses = std::array::from_fn(|lane| Ellipse {
            variance: variance[lane],
            inverse_variance: inverse_variance[lane],
            slope: slope[lane],
            inverse_row_variance: inverse_row_variance[lane],
        });
        (ellipses, is_finite)
    }

    /// Returns half widths and half heights of the rectangles around `q <= q_max`, pixels.
    #[inline(always)]
    pub(super) fn extents(&self, q_max: f32x8<S>) -> [f32x8<S>; 2] {
        let [a, _, c] = self.covariance;
        [(a * q_max).sqrt(), (c * q_max).sqrt()]
    }

    /// Computes the VJP of centres and [`Linearization::ellipses`]: gradients by the points in the camera
    /// frame and by the axes in world coordinates. `by_ellipse` is in the order of
    /// [`super::SplatGradient::ellipse`].
    #[inline(always)]
    pub(super) fn vjp(
        &self,
        view: &View,
        placed: &CameraGaussians8<S>,
        by_ellipse: [f32x8<S>; 5],
    ) -> (Vec3x8<S>, [Vec3x8<S>; 3]) {
        let [by_u, by_v, by_inverse, by_slope, by_row] = by_ellipse;
        let [_, b, c] = self.covariance;
        let row = f32x8::splat(c.simd, 1.0) / c;
        let slope = b * row;
        let inverse_variance = c / self.determinant;
        // variance = A - B^2/C, slope = B/C, row = 1/C.
        let by_variance = -inverse_variance * inverse_variance * by_inverse;
        let by_a = by_variance;
        let by_b = row * by_slope - slope * by_variance * 2.0;
        let by_c = (slope * by_variance - row * by_slope) * slope - row * row * by_row;
        // Sigma = V V^T + 0.3 I.
        let dv_u = self.v_u.times(by_a * 2.0).plus(self.v_v.times(by_b));
        let dv_v = self.v_u.times(by_b).plus(self.v_v.times(by_c * 2.0));
        // V = (J W) M.
        let axes = [
            self.to_u.times(dv_u.x).plus(self.to_v.times(dv_v.x)),
            self.to_u.times(dv_u.y).plus(self.to_v.times(dv_v.y)),
            self.to_u.times(dv_u.z).plus(self.to_v.times(dv_v.z)),
        ];
        let by_row_of_jacobian = |dv: Vec3x8<S>| {
            let sum = placed.axes[0].times(dv.x);
            let sum = placed.axes[1].times_plus(dv.y, sum);
            placed.axes[2]
                .times_plus(dv.z, sum)
                .transformed(&view.rotation)
        };
        let by_jacobian = Jacobian {
            u: by_row_of_jacobian(dv_u),
            v: by_row_of_jacobian(dv_v),
        };
        let point = view.camera.vjp(
            placed.point,
            placed.inverse_distance,
            [by_u, by_v],
            &by_jacobian,
        );
        (point, axes)
    }
}
