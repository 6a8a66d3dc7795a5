//! The photometric loss of 3DGS: `L = (1 - lambda) L1 + lambda (1 - SSIM)`.
//!
//! SSIM as in 3DGS `utils/loss_utils.py`: 11x11 Gaussian window with sigma 1.5, per channel, `C1 = 0.01^2`,
//! `C2 = 0.03^2`, mean over the map. Images are padded with zeros as there (`conv2d` with
//! `padding = window_size // 2`), and as for the metric `ssim` of `bench`. One deviation: the window wraps
//! around the seam of a panorama, because columns 0 and W-1 are neighbours on the sphere ([`Columns`]); a
//! pinhole image is padded. Scores never come from this code: `bench` has its own.
//!
//! With `A1 = 2 mx my + C1`, `A2 = 2 sxy + C2`, `B1 = mx^2 + my^2 + C1`, `B2 = sx + sy + C2` and the blurred
//! `E[x^2] = sx + mx^2`, `E[xy] = sxy + mx my`:
//!
//! ```text
//! s = A1 A2 / (B1 B2)      ds/dE[x^2] = -s / B2      ds/dE[xy] = 2 A1 / (B1 B2)
//! ds/dmx = 2 my A2 / (B1 B2) - 2 mx s / B1 - 2 mx ds/dE[x^2] - my ds/dE[xy]
//! dS/dx = blur(ds/dmx) + 2 x blur(ds/dE[x^2]) + y blur(ds/dE[xy])
//! ```
//!
//! A wrapped or zero-padded blur with a symmetric window is its own transpose. With a mask `w` of weights per
//! pixel, both means become `sum w s / sum w`.

use omnilife_schemas::camera::Camera;

pub mod cpu;
#[cfg(test)]
mod golden_tests;
pub(crate) mod gpu;
mod marks;
pub mod reference;
mod rows;
mod strips;

pub use marks::PixelMarks;

/// Neighbours of the first and the last column of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Columns {
    /// Neighbours on the sphere: the image wraps around the full turn.
    Wrap,
    /// Zeros, as above the first row and below the last one.
    End,
}

impl Columns {
    /// Returns the neighbours for a camera's images.
    pub fn of(camera: &Camera) -> Self {
        if camera.wraps() {
            Self::Wrap
        } else {
            Self::End
        }
    }
}

/// Values of the loss on one image.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LossValue {
    /// The loss that is minimized.
    pub total: f64,
    /// Mean absolute difference.
    pub l1: f64,
    /// Structural similarity, 1 for equal images.
    pub ssim: f64,
    /// Mean squared difference.
    pub mse: f64,
}

impl LossValue {
    /// Returns `-10 log10(MSE)`, with the MSE floored at 1e-10.
    pub fn psnr(&self) -> f64 {
        -10.0 * self.mse.max(1e-10).log10()
    }
}
