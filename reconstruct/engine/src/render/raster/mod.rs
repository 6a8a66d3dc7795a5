//! Rasterization: compositing sorted splats front to back, and its gradient.
//!
//! Per pixel with centre `x`, over the splats of its tile from near to far (3DGS `forward.cu`):
//!
//! ```text
//! alpha_i = min(0.99, o_i exp(-q_i(x) / 2)), skipped when below 1/255
//! stop before splat i when T_i (1 - alpha_i) < 1e-4
//! C = sum_i T_i alpha_i c_i + T_end background,     T_(i+1) = T_i (1 - alpha_i)
//! ```
//!
//! Features are composited like colours, with a background of 0.
//!
//! Backward, with `g = dL/dC` over colours and features and the projected sums
//! `P_i = sum_(j <= i) T_j alpha_j (g . c_j)` and `S = g . C`:
//!
//! ```text
//! dL/dc_i     = T_i alpha_i g
//! dL/dalpha_i = T_i (g . c_i) - (S - P_i) / (1 - alpha_i)
//! ```
//!
//! The backward pass runs front to back like the forward pass: transmittances are the same to the last bit
//! and are never recovered by division. The clamp at 0.99 is ignored by the gradient, as in 3DGS
//! `backward.cu`.
//!
//! **Reproducibility.** The arithmetic is written once over 8 lanes and compiled for each
//! instruction set; the best one of the CPU is chosen at run time. On one machine results
//! are the same to the last bit for any number of threads. Between machines they are the same where
//! both have fused multiply-add (AVX2 with FMA, AVX-512, NEON); without it the last bits differ.

mod composite;
pub mod cpu;
pub(crate) mod gpu;
mod gradient;
mod lanes;
mod shapes;
mod tile;

use omnilife_schemas::RgbImage;

use crate::render::project::{ConeGradient, SplatGradient};

/// Rendered image, and the state for its backward pass.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Raster {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colour, HWC, background included; not clamped.
    pub colour: Vec<f32>,
    /// Feature planes one after another, each row-major; see
    /// [`ActivatedGaussians::features`](crate::gaussians::ActivatedGaussians::features).
    pub features: Vec<f32>,
    /// Transmittance behind the last splat, one per pixel.
    pub transmittance: Vec<f32>,
}

impl Raster {
    /// Returns the colours clamped to `[0, 1]`.
    pub fn image(&self) -> RgbImage {
        RgbImage {
            width: self.width,
            height: self.height,
            data: self
                .colour
                .iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        }
    }
}

/// Gradient of the loss by a [`Raster`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterGradient<'a> {
    /// Gradient by the colour, HWC.
    pub colour: &'a [f32],
    /// Gradient by the feature planes; empty if the loss does not use them.
    pub features: &'a [f32],
}

impl<'a> RasterGradient<'a> {
    /// Makes a gradient of these parts.
    pub fn new(colour: &'a [f32], features: &'a [f32]) -> Self {
        Self { colour, features }
    }
}

/// Gradients by the splats of every trained (splat, tile) entry, in the order of the tiles' lists.
#[derive(Debug, Default)]
pub struct EntryGradients {
    /// Gradients by ellipse, opacity and colour.
    pub splats: Vec<SplatGradient>,
    /// Gradients by the cones of the entries with that shape; otherwise arbitrary.
    pub cones: Vec<ConeGradient>,
    /// Gradients by the features, `feature_count` per entry.
    pub features: Vec<f32>,
}
