//! The stages of rendering and optimization, one folder each: the contract in `mod.rs`, the
//! processor's implementation in `cpu.rs`.
//!
//! ```text
//! forward   project -> sort -> bin -> raster -> loss
//! backward  loss -> raster -> project            then adam
//! ```
//!
//! What a render is, without tiles and tricks, is written down as plain f64 loops in
//! [`crate::reference`]; the kernels are judged by it.

pub mod adam;
pub mod bin;
pub mod loss;
pub mod odgs_published;
pub mod project;
pub mod raster;
pub mod sort;

use serde::{Deserialize, Serialize};

use crate::gaussians::MAX_SH_DEGREE;

/// How a Gaussian's falloff in a pixel is defined; see [`project`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Footprint {
    /// The Gaussian linearized at its centre: an ellipse in the image, or, near the poles and where
    /// it is wide, on the tangent plane.
    #[default]
    Projected,
    /// The largest value of the Gaussian along the pixel's ray: no linearization.
    Ray,
}

/// What a render depends on besides Gaussians and view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Centres nearer than this (normalized units) are not drawn.
    pub near: f32,
    /// Colour behind everything.
    pub background: [f32; 3],
    /// Definition of the falloff.
    pub footprint: Footprint,
    /// Highest degree of harmonics that is used, where the Gaussians store more. The gradient of
    /// what is not used is zero.
    pub sh_degree: usize,
}

impl RenderSettings {
    /// Black background, projected footprints, all harmonics.
    pub fn new(near: f32) -> Self {
        Self {
            near,
            background: [0.0; 3],
            footprint: Footprint::Projected,
            sh_degree: MAX_SH_DEGREE,
        }
    }
}

/// Opacities of a pixel below this do not contribute (3DGS `forward.cu`).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Opacity of one Gaussian in one pixel is clamped here (3DGS `forward.cu`).
pub const ALPHA_MAX: f32 = 0.99;
/// Compositing stops before the transmittance falls below this (3DGS `forward.cu`).
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Added to the diagonal of the projected covariance, square pixels (3DGS `forward.cu`).
pub const LOW_PASS: f32 = 0.3;
/// `cos(85 degrees)`: nearer to a pole of an ERP image than this (`hypot(x, z) < CONE_RHO d`) the
/// ellipse in the image means nothing, and the footprint is a cone.
pub const CONE_RHO: f32 = 0.087_155_744;
/// An ellipse whose standard deviation along the columns of an ERP image is more than this share of
/// the width (six of them cover a quarter turn) is too wide for the image's plane: a cone.
pub const CONE_WIDTH: f32 = 1.0 / 24.0;
/// Side of a tile in pixels.
pub const TILE: usize = 16;
