//! `ssim`: structural similarity as in the 3DGS code.

use omnilife_schemas::records::Direction;

use super::{Metric, Sample, Undefined};

/// SSIM as 3DGS publishes it.
pub(super) const METRIC: Metric = Metric {
    id: "ssim",
    title: "SSIM",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "Wang et al. 2004 with an 11x11 Gaussian window of sigma 1.5, zero padding of 5 \
             pixels (also across the seam), biased moments, C1 = 0.01^2, C2 = 0.03^2, per channel \
             on 8-bit images in [0, 1], mean over the whole map (3DGS utils/loss_utils.py, ssim, \
             as called by metrics.py)",
    needs: &[],
    function: ssim,
};

fn ssim(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let map = sample.ssim_map().zero_padded.iter().enumerate();
    let counted = map.filter(|&(pixel, _)| sample.pair.counts(pixel));
    let sum: f64 = counted.map(|(_, value)| value).sum();
    Ok(sum / sample.pair.counted_pixels() as f64)
}
