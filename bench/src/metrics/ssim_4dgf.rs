//! `ssim-4dgf`: structural similarity as in papers on dynamic urban scenes.

use omnilife_schemas::records::Direction;

use super::{Metric, Sample, Undefined};

/// SSIM as 4DGF and its successors on UAV video publish it for whole images.
///
/// Their code clamps variances to at least 0 and the covariance to the variances' geometric mean, which rounding in f32
/// can exceed. In f64 that changes no value by more than 1e-12.
pub(super) const METRIC: Metric = Metric {
    id: "ssim-4dgf",
    title: "SSIM (4DGF)",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "Wang et al. 2004 with an 11x11 Gaussian window of sigma 1.5, biased moments, C1 = 0.01^2, \
             C2 = 0.03^2, mean over channels and the pixels at least 5 from the border, 8-bit images in \
             [0, 1] (map4d common/metric.py, as Mip-NeRF's); undefined below 11x11 pixels",
    needs: &[],
    function: ssim,
};

fn ssim(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let mean = sample.ssim_map().valid_biased_mean;
    mean.ok_or(Undefined("the image is smaller than 11x11 pixels"))
}
