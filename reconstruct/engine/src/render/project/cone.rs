//! The cone of a Gaussian seen from the camera, and its VJP.

use glam::{Mat3, Vec3, vec3};

use crate::render::project::{Cone, ConeGradient, ellipse::ShapeGradient, place::CameraGaussian};
use crate::{
    camera::{CameraKernels, PixelBox, View, tangent_frame},
    render::settings::Footprint,
};

/// Intermediate values shared by forward and backward. Lengths are in units of the distance.
pub(super) struct Conic {
    /// Unit direction of the centre, camera frame.
    n: Vec3,
    /// `e_1`, `e_2`.
    frame: [Vec3; 2],
    /// `W M / d` as columns, camera frame.
    axes: [Vec3; 3],
    /// `V_1`, `V_2`, `V_n`.
    v: [Vec3; 2],
    v_n: Vec3,
    /// `F`: `rows[k][i]` is `F_ki`.
    rows: [[f32; 2]; 2],
    /// `S^-1` as `[[a, b], [b, c]]`.
    inverse: [f32; 3],
    /// Largest eigenvalue of `S`, at most doubled.
    spread: f32,
    /// `h`, zero for a flat cone.
    slope: [f32; 2],
    /// `sigma_k^2 / d^2 + s^2`.
    variances: [f32; 3],
    /// `eps`, zero for a flat cone.
    depth_variance: f32,
    is_exact: bool,
}

impl Conic {
    pub(super) fn new(
        view: &View,
        placed: &CameraGaussian,
        scale: [f32; 3],
        footprint: Footprint,
    ) -> Self {
        let low_pass = view.camera.angular_low_pass();
        let inverse_distance = 1.0 / placed.distance;
        let n = placed.point * inverse_distance;
        let frame = tangent_frame(n);
        let axes = placed
            .axes
            .map(|axis| view.rotation * axis * inverse_distance);
        let along = |row: Vec3| vec3(row.dot(axes[0]), row.dot(axes[1]), row.dot(axes[2]));
        let (v, v_n) = (frame.map(along), along(n));
        let squares = [v[0].length_squared(), v[1].length_squared()];
        let (a, b, c) = (squares[0] + low_pass, v[0].dot(v[1]), squares[1] + low_pass);
        let determinant = v[0].cross(v[1]).length_squared()
            + low_pass * (squares[0] + squares[1])
            + low_pass * low_pass;
        // S = L L^T with L = [[l11, 0], [l21, l22]]; F = L^-1.
        let f11 = 1.0 / a.sqrt();
        let f22 = (a / determinant).sqrt();
        let f21 = -b / a * f22;
        let inverse = [c / determinant, -b / determinant, a / determinant];
        let variances = scale.map(|sigma| (sigma * inverse_distance).powi(2) + low_pass);
        let is_exact = footprint == Footprint::Ray;
        let (slope, depth_variance) = if is_exact {
            let g = [v[0].dot(v_n), v[1].dot(v_n)];
            (
                [
                    inverse[0] * g[0] + inverse[1] * g[1],
                    inverse[1] * g[0] + inverse[2] * g[1],
                ],
                variances[0] * variances[1] * variances[2] / determinant,
            )
        } else {
            ([0.0; 2], 0.0)
        };
        Self {
            n,
            frame,
            axes,
            v,
            v_n,
            rows: [[f11, 0.0], [f21, f22]],
            inverse,
            spread: a + c,
            slope,
            variances,
            depth_variance,
            is_exact,
        }
    }

    pub(super) fn cone(&self) -> Cone {
        let [e1, e2] = self.frame;
        Cone {
            across: self.rows.map(|[f1, f2]| f1 * e1 + f2 * e2),
            along: self.n - self.slope[0] * e1 - self.slope[1] * e2,
            depth_variance: self.depth_variance,
        }
    }

    /// Returns a rectangle around `q <= q_max`.
    ///
    /// With `y = F a` on the tangent plane the footprint is `|y| <= sqrt(q') (1 - y.L^T h)`, so
    /// `|y| <= sqrt(q') / (1 - sqrt(q') |L^T h|)`, and the angle's tangent is at most `|y| sqrt(spread)`.
    pub(super) fn bounds(&self, view: &View, q_max: f32) -> PixelBox {
        let Some(ratio) = self.cone().largest_ratio(q_max) else {
            return PixelBox::EVERYTHING;
        };
        let root = ratio.sqrt();
        // |L^T h|^2 = h^T S h = g^T S^-1 g = h.g.
        let tilt = (self.slope[0] * self.v[0].dot(self.v_n)
            + self.slope[1] * self.v[1].dot(self.v_n))
        .max(0.0)
        .sqrt();
        let rest = 1.0 - root * tilt;
        if rest <= 0.0 {
            return PixelBox::EVERYTHING;
        }
        let radius = (root / rest * self.spread.sqrt()).atan();
        let pixel = view.camera.pixel(self.n);
        view.camera.cap_box(self.n, pixel, radius)
    }

    /// Computes the VJP of [`Conic::cone`], and the part of the gradient by the scales that does not go
    /// through the axes.
    ///
    /// The frame follows `n` without turning about it: `de_i = -(e_i . dn) n`.
    pub(super) fn vjp(
        &self,
        view: &View,
        placed: &CameraGaussian,
        scale: [f32; 3],
        gradient: &ConeGradient,
    ) -> (ShapeGradient, [f32; 3]) {
        let by_across = [
            Vec3::from_slice(&gradient[0..3]),
            Vec3::from_slice(&gradient[3..6]),
        ];
        let by_along = Vec3::from_slice(&gradient[6..9]);
        let by_depth = if self.is_exact { gradient[9] } else { 0.0 };
        let by_frame = |vector: Vec3| [vector.dot(self.frame[0]), vector.dot(self.frame[1])];
        let by_rows = by_across.map(by_frame);
        let by_along_frame = by_frame(by_along);
        // By e_i . dn, with F and h fixed: the footprint moves rigidly.
        let mut turn: [f32; 2] = std::array::from_fn(|i| {
            let across: f32 = (0..2)
                .map(|k| self.rows[k][i] * by_across[k].dot(self.n))
                .sum();
            by_along_frame[i] + self.slope[i] * by_along.dot(self.n) - across
        });
        let moved = turn[0] * self.frame[0] + turn[1] * self.frame[1];
        let centre = view.camera.pixel_step(self.n).map(|step| step.dot(moved));

        // S^-1 = F^T F: dL/dS = -1/2 F^T (dL/dF) S^-1, symmetrized.
        let [ia, ib, ic] = self.inverse;
        let product: [[f32; 2]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..2).map(|k| self.rows[k][i] * by_rows[k][j]).sum())
        });
        let times_inverse = |row: [f32; 2]| [row[0] * ia + row[1] * ib, row[0] * ib + row[1] * ic];
        let [d0, d1] = product.map(times_inverse);
        let mut by_s = [-0.5 * d0[0], -0.25 * (d0[1] + d1[0]), -0.5 * d1[1]];
        // h = S^-1 g.
        let mut by_g = [0.0; 2];
        if self.is_exact {
            let [h1, h2] = self.slope;
            by_g = times_inverse([-by_along_frame[0], -by_along_frame[1]]);
            by_s[0] -= by_g[0] * h1;
            by_s[1] -= 0.5 * (by_g[0] * h2 + by_g[1] * h1);
            by_s[2] -= by_g[1] * h2;
            // eps = prod_k(...) / det S.
            let by_log = by_depth * self.depth_variance;
            by_s[0] -= by_log * ia;
            by_s[1] -= by_log * ib;
            by_s[2] -= by_log * ic;
        }
        // S = V V^T + s^2 I, g = V V_n.
        let by_v = [
            2.0 * (by_s[0] * self.v[0] + by_s[1] * self.v[1]) + by_g[0] * self.v_n,
            2.0 * (by_s[1] * self.v[0] + by_s[2] * self.v[1]) + by_g[1] * self.v_n,
        ];
        let by_v_n = by_g[0] * self.v[0] + by_g[1] * self.v[1];
        for i in 0..2 {
            turn[i] += by_v_n.dot(self.v[i]) - by_v[i].dot(self.v_n);
        }
        let inverse_distance = 1.0 / placed.distance;
        let by_axes: [Vec3; 3] = std::array::from_fn(|k| {
            by_v[0][k] * self.frame[0] + by_v[1][k] * self.frame[1] + by_v_n[k] * self.n
        });
        let mut by_log_distance: f32 = -(0..3).map(|k| by_axes[k].dot(self.axes[k])).sum::<f32>();
        let by_scale = std::array::from_fn(|k| {
            // d eps / d ln(sigma_k / d), twice eps sigma_k^2 / d^2 over the variance.
            let relative = scale[k] * inverse_distance;
            let by_relative = 2.0 * by_depth * self.depth_variance * relative / self.variances[k];
            by_log_distance -= by_relative * relative;
            by_relative * inverse_distance
        });
        let point = (turn[0] * self.frame[0] + turn[1] * self.frame[1] + by_log_distance * self.n)
            * inverse_distance;
        let to_world: Mat3 = view.rotation.transpose();
        let shape = ShapeGradient {
            point,
            axes: by_axes.map(|axis| to_world * axis * inverse_distance),
            centre,
        };
        (shape, by_scale)
    }
}
