//! Projection: from instantaneous Gaussians to ellipses in the image.
//!
//! For a Gaussian with centre `mu`, axes `M = R S` and a camera with rotation `W` and centre `c`
//! (EWA splatting as 3DGS `forward.cu` and ODGS `forward.cu` do it, with the Jacobian of
//! [`crate::camera`]):
//!
//! ```text
//! p = W (mu - c)        d = |p|, culled when d <= near
//! V = J(p) W M          2x3, pixels
//! Sigma = V V^T + 0.3 I
//! det Sigma = |V_u x V_v|^2 + 0.3 (|V_u|^2 + |V_v|^2) + 0.09     (Lagrange's identity: no
//!                                                                cancellation for needles)
//! alpha(x) = min(0.99, o exp(-q/2)),  q = (x - u)^T Sigma^-1 (x - u),  columns wrapped at the seam
//! colour = max(1/2 + sum_k Y_k((mu - c) / d) sh_k, 0)
//! ```
//!
//! A Gaussian contributes where `alpha >= 1/255`, that is `q <= 2 ln(255 o)`. This is the whole
//! definition of a footprint: the published 3-sigma squares depend on the tile grid and are not
//! reproduced. A Gaussian whose centre is nearer than `near` or whose largest axis is longer than
//! its distance (the linearization means nothing there) is culled.

pub mod cpu;
mod sh;

use glam::Vec3;

/// A visible Gaussian in image coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Splat {
    /// Centre in pixels; the column is in [0, W].
    pub centre: [f32; 2],
    /// Entries a, b, c of the inverse covariance `[[a, b], [b, c]]`, per square pixel.
    pub conic: [f32; 3],
    /// Entries of the covariance, square pixels.
    pub covariance: [f32; 3],
    /// Half width and half height of the footprint in pixels.
    pub extent: [f32; 2],
    /// Largest `q` inside the footprint.
    pub q_max: f32,
    /// Opacity in (0, 1).
    pub opacity: f32,
    /// Colour, red green blue, not negative.
    pub colour: [f32; 3],
    /// Distance from the camera: the sort key.
    pub distance: f32,
    /// Index of the Gaussian.
    pub gaussian: u32,
}

/// Gradients of the loss by a [`Splat`]'s fields.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SplatGradient {
    /// By the centre, per pixel.
    pub centre: [f32; 2],
    /// By the three conic entries; b counts once (it stands twice in the matrix).
    pub conic: [f32; 3],
    /// By the opacity.
    pub opacity: f32,
    /// By the colour.
    pub colour: [f32; 3],
}

/// Axes `M = R S` as columns, from a unit quaternion (w, x, y, z) and scales.
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
