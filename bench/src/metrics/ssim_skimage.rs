//! `ssim-skimage`: structural similarity as in scikit-image.

use omnilife_schemas::records::Direction;

use super::{Metric, Sample, Undefined};

/// SSIM as PanSplat and its relatives publish it.
pub(super) const METRIC: Metric = Metric {
    id: "ssim-skimage",
    title: "SSIM (scikit-image)",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "scikit-image's structural_similarity with win_size 11, gaussian_weights (sigma 1.5), \
             data_range 1 and its default use_sample_covariance (moments times 121/120): mean over \
             channels and the pixels at least 5 from the border, 8-bit images in [0, 1] (PanSplat \
             and Splatter-360 src/evaluation/metrics.py); undefined below 11x11 pixels",
    needs: &[],
    function: ssim,
};

fn ssim(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let mean = sample.ssim_map().valid_mean;
    mean.ok_or(Undefined("the image is smaller than 11x11 pixels"))
}
