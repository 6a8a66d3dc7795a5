//! What a render depends on besides Gaussians and view, and the constants of compositing.

use serde::{Deserialize, Serialize};

use crate::gaussians::MAX_SH_DEGREE;

/// How a Gaussian's falloff in a pixel is defined; see [`super::project`].
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
/// Side of a tile in pixels.
pub const TILE: usize = 16;

/// Which renderer makes images from Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererChoice {
    /// [`crate::render`].
    Exact,
    /// [`crate::render::published`], defects included.
    OdgsPublished,
}
