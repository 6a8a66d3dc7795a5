//! The metrics: what a score is.
//!
//! To add one: a file with a [`Metric`], a line in [`METRICS`], and golden values through
//! `scripts/golden/metrics.py`, an implementation apart from this one.
//!
//! All metrics compare 8-bit images, as 3DGS's `metrics.py` does, which reads rendered and
//! captured views back from PNG files: prediction and ground truth are both quantized. Against
//! scores of unquantized renderings (ODGS and PVG during training) this matters above about 45 dB.
//! Values are `byte / 255` in f64 and sums are taken in a fixed order, so that a score is the same
//! on every machine and for every number of threads.

mod psnr;
mod psnr_channels;
mod ssim;
mod ws_psnr;

use omnilife_schemas::records::{Direction, Protocol};

use crate::{error::BenchError, protocols};

/// A predicted view and its ground truth: two 8-bit RGB images of the same size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViewPair {
    width: usize,
    height: usize,
    prediction: Vec<u8>,
    truth: Vec<u8>,
}

impl ViewPair {
    /// Two images of `width` x `height` pixels, row-major, three interleaved channels.
    ///
    /// `None` when an image does not hold `width * height * 3` bytes or holds none.
    pub fn new(width: usize, height: usize, prediction: Vec<u8>, truth: Vec<u8>) -> Option<Self> {
        let bytes = width.checked_mul(height)?.checked_mul(3)?;
        (bytes > 0 && prediction.len() == bytes && truth.len() == bytes).then_some(Self {
            width,
            height,
            prediction,
            truth,
        })
    }

    /// Pixels per row, at least 1.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows, at least 1.
    pub fn height(&self) -> usize {
        self.height
    }

    /// `height * width * 3` bytes of the prediction.
    pub fn prediction(&self) -> &[u8] {
        &self.prediction
    }

    /// `height * width * 3` bytes of the ground truth.
    pub fn truth(&self) -> &[u8] {
        &self.truth
    }

    /// Sum over one row (0 at the top) of the squared byte differences of channels 0, 1 and 2:
    /// exact integers, so that no order of summation can change a score.
    pub(crate) fn row_squared_errors(&self, row: usize) -> [u64; 3] {
        let range = row * self.width * 3..(row + 1) * self.width * 3;
        let mut sums = [0_u64; 3];
        for (predicted, true_value) in self.prediction[range.clone()]
            .chunks_exact(3)
            .zip(self.truth[range].chunks_exact(3))
        {
            for channel in 0..3 {
                let difference = u64::from(predicted[channel].abs_diff(true_value[channel]));
                sums[channel] += difference * difference;
            }
        }
        sums
    }

    /// Sum over the whole image of the squared byte differences of channels 0, 1 and 2.
    pub(crate) fn squared_errors(&self) -> [u64; 3] {
        (0..self.height)
            .map(|row| self.row_squared_errors(row))
            .fold([0; 3], |sums, row| [0, 1, 2].map(|c| sums[c] + row[c]))
    }
}

/// A metric: a number for a predicted view beside its ground truth.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// Id, unique in [`METRICS`]. Variants of a metric are metrics of their own.
    pub id: &'static str,
    /// Name for people.
    pub title: &'static str,
    /// Unit; empty for plain numbers.
    pub unit: &'static str,
    /// Which of two scores is the better one.
    pub direction: Direction,
    /// Lowest and highest possible value.
    pub range: [f64; 2],
    /// The definition: formula, conventions and where they are published.
    pub source: &'static str,
    /// Computes it; deterministic, finite for every pair.
    pub function: fn(&ViewPair) -> f64,
}

/// Every metric.
pub static METRICS: &[Metric] = &[
    psnr::METRIC,
    psnr_channels::METRIC,
    ssim::METRIC,
    ws_psnr::METRIC,
];

/// The metrics that a protocol asks for, in its order.
///
/// # Errors
/// [`BenchError::UnknownMetric`], which lists the known ids.
pub fn of_protocol(protocol: &Protocol) -> Result<Vec<&'static Metric>, BenchError> {
    protocol
        .metrics
        .iter()
        .map(|id| {
            METRICS
                .iter()
                .find(|metric| metric.id == id)
                .ok_or_else(|| BenchError::UnknownMetric {
                    protocol: protocols::title(protocol),
                    metric: id.clone(),
                    known: METRICS
                        .iter()
                        .map(|metric| metric.id)
                        .collect::<Vec<_>>()
                        .join(", "),
                })
        })
        .collect()
}

/// The mean squared error, in squared `[0, 1]` units, below which PSNR values are cut off.
const MSE_FLOOR: f64 = 1e-10;

/// PSNR in decibels, in [0, 100], of a mean squared error in squared `[0, 1]` units.
fn decibels(mse: f64) -> f64 {
    // Subtracted from zero, so that an error of 1 gives 0 and not -0.
    0.0 - 10.0 * mse.clamp(MSE_FLOOR, 1.0).log10()
}
