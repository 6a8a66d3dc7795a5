//! `ws-ssim`: SSIM with every row weighted by its share of the sphere.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, Sample, Undefined, latitude};

/// Weighted-to-spherically-uniform SSIM.
pub(super) const METRIC: Metric = Metric {
    id: "ws-ssim",
    title: "WS-SSIM",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "sum of w_j SSIM over pixels and channels / (3 W sum of w_j), the map that of ssim, \
             w_j = cos((j + 1/2 - H/2) pi / H) for row j of H (ODGS utils/loss_utils.py)",
    needs: &[Need::Sphere],
    function: ws_ssim,
};

fn ws_ssim(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let [width, height] = sample.pair.size();
    let pair = sample.pair;
    let (mut weighted, mut weights) = (0.0, 0.0);
    for (row, values) in sample
        .ssim_map()
        .zero_padded
        .chunks_exact(width)
        .enumerate()
    {
        let weight = latitude::cosine(row, height);
        let counted = (0..width).filter(|column| pair.counts(row * width + column));
        weighted += weight * counted.map(|column| values[column]).sum::<f64>();
        weights += weight * pair.counted_in_row(row) as f64;
    }
    Ok(weighted / weights)
}
