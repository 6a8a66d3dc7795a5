//! `ws-psnr`: PSNR with every row weighted by its share of the sphere.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, Sample, Undefined, decibels, latitude};

/// Weighted-to-spherically-uniform PSNR.
pub(super) const METRIC: Metric = Metric {
    id: "ws-psnr",
    title: "WS-PSNR",
    unit: "dB",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 100.0],
    source: "-10 log10(WS-MSE), WS-MSE = sum of w_j e^2 over pixels and channels / (3 W sum of \
             w_j), w_j = cos((j + 1/2 - H/2) pi / H) for row j of H (Sun, Lu and Yu 2017; ODGS \
             utils/image_utils.py; PanSplat src/evaluation/metrics.py), 8-bit ERP images in \
             [0, 1]. WS-MSE is floored at 1e-10",
    needs: &[Need::Sphere],
    function: ws_psnr,
};

fn ws_psnr(sample: &Sample<'_>) -> Result<f64, Undefined> {
    let pair = sample.pair;
    let mut weighted = 0.0;
    let mut weights = 0.0;
    for row in 0..pair.height() {
        let weight = latitude::cosine(row, pair.height());
        let sum: u64 = pair.row_squared_errors(row).iter().sum();
        weighted += weight * sum as f64;
        weights += weight * (3 * pair.counted_in_row(row)) as f64;
    }
    Ok(decibels(weighted / (weights * 255.0 * 255.0)))
}
