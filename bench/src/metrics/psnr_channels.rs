//! `psnr-channels`: mean over the channels of their PSNRs.

use omnilife_schemas::records::Direction;

use super::{Metric, Sample, Undefined, decibels};

/// PSNR as 3DGS and ODGS print it while training.
pub(super) const METRIC: Metric = Metric {
    id: "psnr-channels",
    title: "PSNR (channels)",
    unit: "dB",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 100.0],
    source: "mean over red, green and blue of -10 log10(MSE of the channel), 8-bit images in \
             [0, 1] (the convention of the training logs of 3DGS and ODGS, train.py \
             training_report, which score unquantized renderings). Never below psnr, by Jensen's \
             inequality. The MSE of each channel is floored at 1e-10",
    needs: &[],
    function: psnr_channels,
};

fn psnr_channels(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let pair = sample.pair;
    let pixels = pair.counted_pixels() as f64;
    let sum: f64 = pair
        .squared_errors()
        .iter()
        .map(|&channel| decibels(channel as f64 / (pixels * 255.0 * 255.0)))
        .sum();
    Ok(sum / 3.0)
}
