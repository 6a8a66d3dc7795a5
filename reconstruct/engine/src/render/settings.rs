//! Settings of a render, and the constants of compositing.

use serde::{Deserialize, Serialize};

use crate::gaussians::MAX_SH_DEGREE;

/// Definition of a Gaussian's falloff in a pixel; see [`super::project`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Footprint {
    /// Gaussian linearized at its centre: an ellipse in the image or, near the poles and for wide footprints,
    /// on the tangent plane.
    #[default]
    Projected,
    /// Largest value of the Gaussian along the pixel's ray, without linearization.
    Ray,
}

/// Settings of a render.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Centres nearer than this (normalized units) are not drawn.
    pub near: f32,
    /// Background colour, [0, 1].
    pub background: [f32; 3],
    /// Definition of the falloff.
    pub footprint: Footprint,
    /// Highest degree of harmonics in use; further stored ones are ignored, and their gradient is zero.
    pub sh_degree: usize,
}

impl RenderSettings {
    /// Creates settings with black background, projected footprints and all harmonics.
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
/// Upper clamp of the opacity of one Gaussian in one pixel (3DGS `forward.cu`).
pub const ALPHA_MAX: f32 = 0.99;
/// Compositing stops before the transmittance falls below this (3DGS `forward.cu`).
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Side of a tile in pixels.
pub const TILE: usize = 16;

/// Choice of renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererChoice {
    /// The exact renderer, [`crate::render`].
    Exact,
    /// The renderer of ODGS with its defects, [`crate::render::published`].
    OdgsPublished,
}
