//! `psnr`: peak signal-to-noise ratio over all pixels and channels.

use omnilife_schemas::records::Direction;

use super::{Metric, Sample, Undefined, decibels};

/// PSNR as 3DGS publishes it.
pub(super) const METRIC: Metric = Metric {
    id: "psnr",
    title: "PSNR",
    unit: "dB",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 100.0],
    source: "-10 log10(MSE), MSE over all pixels and channels of 8-bit images in [0, 1], one value \
             per image (3DGS metrics.py and utils/image_utils.py). MSE is floored at 1e-10, so \
             identical images score 100 dB instead of infinity",
    needs: &[],
    function: psnr,
};

fn psnr(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let pair = sample.pair;
    let values = (3 * pair.counted_pixels()) as f64;
    let sum: u64 = pair.squared_errors().iter().sum();
    Ok(decibels(sum as f64 / (values * 255.0 * 255.0)))
}
