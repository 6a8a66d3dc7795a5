//! Projection of activated Gaussians to footprints in the image.
//!
//! For a Gaussian with centre `mu`, axes `M = R S` and a camera with rotation `W` and centre `c`:
//!
//! ```text
//! p = W (mu - c)       d = |p|, drawn when d > near       n = p / d
//! colour = max(1/2 + sum_k Y_k((mu - c) / d) sh_k, 0)
//! alpha(x) = min(0.99, o exp(-q(x)/2)), drawn where alpha >= 1/255, that is q <= 2 ln(255 o)
//! ```
//!
//! This is the whole definition of a footprint: the published 3-sigma squares depend on the tile grid and are
//! not reproduced. There are two forms of `q`.
//!
//! **Ellipse** (EWA splatting as 3DGS `forward.cu` and ODGS `forward.cu` do it, with the Jacobian of
//! [`crate::camera`]); in an ERP image columns are wrapped at the seam:
//!
//! ```text
//! V = J(p) W M                                   2x3, pixels
//! Sigma = V V^T + 0.3 I = [[A, B], [B, C]]
//! det Sigma = |V_u x V_v|^2 + 0.3 (|V_u|^2 + |V_v|^2) + 0.09     (Lagrange's identity: no
//!                                                                cancellation for needles)
//! q(x) = (x - u)^T Sigma^-1 (x - u) = (dx - B/C dy)^2 C/det + dy^2 / C
//! ```
//!
//! **Cone** (evaluated per pixel on its ray `r`; no pole, no seam), with `[e_1, e_2]` orthogonal to
//! `n` and everything as an angle, that is in units of `d`:
//!
//! ```text
//! V_i = e_i^T W M / d,  V_n = n^T W M / d        radians
//! S = V V^T + s^2 I,    s^2 = 0.3 (pi/H)^2 for ERP, 0.3 / (fx fy) for a pinhole
//! det S by Lagrange's identity as above;  F^T F = S^-1 (inverse of the Cholesky factor)
//! f_i = F_i1 e_1 + F_i2 e_2          m = n - h_1 e_1 - h_2 e_2
//! N = (f_1.r)^2 + (f_2.r)^2          l = max(m.r, 0)          q = N / (l^2 + eps N)
//! ```
//!
//! With `h = 0`, `eps = 0` this is the Gaussian flattened onto its tangent plane (a gnomonic projection about
//! its own centre). With
//!
//! ```text
//! h = S^-1 V V_n^T       eps = prod_k(sigma_k^2 / d^2 + s^2) / det S
//! ```
//!
//! `q` is exactly the smallest squared Mahalanobis distance along the ray, `t >= 0`, of the Gaussian with
//! covariance `M M^T + (s d)^2 I`: Schur's complement splits `Sigma^-1` into the tangential `S^-1`, the slope
//! `h` of the depth's regression on it, and the conditional variance `eps` of the depth. The low-pass filter
//! is an isotropic widening in space, as wide as a pixel at the image's centre seen from the camera.
//!
//! Shapes drawn for each setting:
//!
//! * [`Footprint::Projected`](super::settings::Footprint): ellipses, and flat cones in an ERP image for
//!   `hypot(n_x, n_z) <` [`CONE_RHO`](crate::camera::CONE_RHO) and `sqrt(A) >` [`CONE_WIDTH`](crate::camera::CONE_WIDTH)
//!   ` W`. A Gaussian whose largest axis is longer than its distance is left out: the linearization
//!   means nothing there.
//! * [`Footprint::Ray`](super::settings::Footprint): exact cones for all.

pub mod by_camera;
mod cone;
pub mod cpu;
mod ellipse;
pub(crate) mod gpu;
mod place;
pub mod sh;

use glam::Vec3;

/// The splats of one view, one per Gaussian.
#[derive(Debug, Clone, Default)]
pub struct Splats {
    /// Data of a splat that every pass reads.
    pub all: Vec<Splat>,
    /// Cones of the splats of that shape, by the same index; otherwise arbitrary.
    pub cones: Vec<Cone>,
}

impl Splats {
    /// Resizes to `len` splats. Existing entries have arbitrary values afterwards.
    pub fn resize(&mut self, len: usize) {
        self.all.resize(len, Splat::default());
        self.cones.resize(len, Cone::default());
    }
}

/// Footprint and colour of a visible Gaussian: one cache line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(align(64))]
pub struct Splat {
    /// Centre of a rectangle around the footprint, pixels; for an ellipse, its own centre.
    pub centre: [f32; 2],
    /// Half width and half height of the rectangle.
    pub extent: [f32; 2],
    /// Binary logarithm of the opacity.
    pub log2_opacity: f32,
    /// Colour, red green blue, not negative.
    pub colour: [f32; 3],
    /// Form of `q`.
    pub shape: Shape,
}

/// The two forms of `q`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A quadratic form in pixel coordinates.
    Ellipse(Ellipse),
    /// A quotient of quadratic forms in rays: the [`Cone`] of the same index in [`Splats::cones`].
    Cone,
}

impl Default for Shape {
    fn default() -> Self {
        Self::Ellipse(Ellipse::default())
    }
}

/// `q = (dx - slope dy)^2 / variance + dy^2 inverse_row_variance`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ellipse {
    /// Variance within a row of pixels, `det Sigma / C`, square pixels.
    pub variance: f32,
    /// `C / det Sigma`.
    pub inverse_variance: f32,
    /// Columns by which a row's mean moves per row, `B / C`.
    pub slope: f32,
    /// `1 / C`, per square pixel.
    pub inverse_row_variance: f32,
}

/// `q = N / (l^2 + eps N)` with `N = (f_1.r)^2 + (f_2.r)^2` and `l = max(m.r, 0)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cone {
    /// `f_1`, `f_2`: per radian, in the camera frame.
    pub across: [Vec3; 2],
    /// `m`, in the camera frame.
    pub along: Vec3,
    /// `eps`, the relative variance of the depth.
    pub depth_variance: f32,
}

/// Gradients of the loss by a [`Splat`]'s fields.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SplatGradient {
    /// Gradient by an ellipse: centre (2), inverse variance, slope, inverse row variance. 0 for a cone, which
    /// has a [`ConeGradient`].
    pub ellipse: [f32; 5],
    /// Gradient by the natural logarithm of the opacity.
    pub log_opacity: f32,
    /// Gradient by the colour.
    pub colour: [f32; 3],
}

impl SplatGradient {
    pub(crate) fn accumulate(&mut self, other: &Self) {
        for (sum, value) in self.ellipse.iter_mut().zip(other.ellipse) {
            *sum += value;
        }
        for (sum, value) in self.colour.iter_mut().zip(other.colour) {
            *sum += value;
        }
        self.log_opacity += other.log_opacity;
    }
}

/// Gradient of the loss by a [`Cone`]: `f_1` (3), `f_2` (3), `m` (3), `eps`.
pub type ConeGradient = [f32; 10];

/// Returns the largest `q` of a footprint, `2 ln(255 o)`, from the opacity's binary logarithm.
#[inline(always)]
pub fn largest_q(log2_opacity: f32) -> f32 {
    const LOG2_255: f32 = 7.994_353_5;
    2.0 * std::f32::consts::LN_2 * (log2_opacity + LOG2_255)
}

impl Cone {
    /// Returns `q' = q_max / (1 - eps q_max)`: the footprint is where `N <= q' l^2`. `None` if it is
    /// everywhere, because the camera itself is inside.
    pub fn largest_ratio(&self, q_max: f32) -> Option<f32> {
        let rest = 1.0 - self.depth_variance * q_max;
        (rest > 0.0).then(|| q_max / rest)
    }
}

/// Returns the axes `M = R S` as columns, from a unit quaternion (w, x, y, z) and scales.
pub(crate) fn axes(rotation: [f32; 4], scale: [f32; 3]) -> [Vec3; 3] {
    let [w, x, y, z] = rotation;
    let r = [
        Vec3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ),
        Vec3::new(
            2.0 * (x * y - w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + w * x),
        ),
        Vec3::new(
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ),
    ];
    [r[0] * scale[0], r[1] * scale[1], r[2] * scale[2]]
}

/// Computes the VJP of [`axes`]: gradients by the scales and by the unit quaternion.
pub(crate) fn axes_vjp(
    rotation: [f32; 4],
    scale: [f32; 3],
    d_axes: &[Vec3; 3],
) -> ([f32; 3], [f32; 4]) {
    let [w, x, y, z] = rotation;
    let unscaled = axes(rotation, [1.0; 3]);
    let d_scale = [
        d_axes[0].dot(unscaled[0]),
        d_axes[1].dot(unscaled[1]),
        d_axes[2].dot(unscaled[2]),
    ];
    let [c0, c1, c2] = [
        d_axes[0] * scale[0],
        d_axes[1] * scale[1],
        d_axes[2] * scale[2],
    ];
    let d_rotation = [
        2.0 * (z * (c0.y - c1.x) + y * (c2.x - c0.z) + x * (c1.z - c2.y)),
        2.0 * (y * (c0.y + c1.x) + z * (c0.z + c2.x) + w * (c1.z - c2.y) - 2.0 * x * (c1.y + c2.z)),
        2.0 * (x * (c0.y + c1.x) + z * (c1.z + c2.y) + w * (c2.x - c0.z) - 2.0 * y * (c0.x + c2.z)),
        2.0 * (x * (c0.z + c2.x) + y * (c1.z + c2.y) + w * (c0.y - c1.x) - 2.0 * z * (c0.x + c1.y)),
    ];
    (d_scale, d_rotation)
}
