//! `ssim`: structural similarity as the 3DGS code computes it.

use omnilife_schemas::records::Direction;
use rayon::prelude::*;

use super::{Metric, ViewPair};

/// SSIM as 3DGS publishes it.
pub(super) const METRIC: Metric = Metric {
    id: "ssim",
    title: "SSIM",
    unit: "",
    direction: Direction::HigherIsBetter,
    range: [-1.0, 1.0],
    source: "Wang et al. 2004 with an 11x11 Gaussian window of sigma 1.5, zero padding of 5 \
             pixels (also across the seam), biased moments, C1 = 0.01^2, C2 = 0.03^2, per channel \
             on 8-bit images in [0, 1], mean over the whole map (3DGS utils/loss_utils.py, ssim, \
             as called by metrics.py)",
    function: ssim,
};

const RADIUS: usize = 5;
const WINDOW: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

fn ssim(pair: &ViewPair) -> f64 {
    let window = gaussian_window();
    // Row sums are collected and added in order: the score does not depend on the scheduling.
    let rows: Vec<f64> = (0..pair.height())
        .into_par_iter()
        .map(|row| row_sum(pair, row, &window))
        .collect();
    rows.iter().sum::<f64>() / (pair.width() * pair.height() * 3) as f64
}

/// Samples of the Gaussian at -5 ..= 5 that sum to 1.
fn gaussian_window() -> [f64; WINDOW] {
    let samples: [f64; WINDOW] = std::array::from_fn(|index| {
        let distance = index as f64 - RADIUS as f64;
        (-distance * distance / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = samples.iter().sum();
    samples.map(|sample| sample / sum)
}

/// Vertically filtered values of one row and one channel: x, y, x^2, y^2, xy.
struct Moments([Vec<f64>; 5]);

/// Sum of the SSIM map over one row and all channels.
///
/// The window is separable: a row is filtered vertically into five rows of moments, then
/// horizontally where the map is evaluated, so memory is a few rows whatever the image's size.
fn row_sum(pair: &ViewPair, row: usize, window: &[f64; WINDOW]) -> f64 {
    (0..3)
        .map(|channel| {
            let moments = vertical_moments(pair, row, channel, window);
            (0..pair.width())
                .map(|column| similarity(horizontal(&moments, column, window)))
                .sum::<f64>()
        })
        .sum()
}

fn vertical_moments(
    pair: &ViewPair,
    row: usize,
    channel: usize,
    window: &[f64; WINDOW],
) -> Moments {
    let width = pair.width();
    let mut sums: [Vec<f64>; 5] = std::array::from_fn(|_| vec![0.0; width]);
    for (offset, &weight) in window.iter().enumerate() {
        // Rows outside the image are zero and add nothing.
        let Some(source) = (row + offset).checked_sub(RADIUS) else {
            continue;
        };
        if source >= pair.height() {
            break;
        }
        let begin = source * width * 3;
        let values =
            |image: &[u8], column: usize| f64::from(image[begin + column * 3 + channel]) / 255.0;
        for column in 0..width {
            let x = values(pair.prediction(), column);
            let y = values(pair.truth(), column);
            for (sum, value) in sums.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                sum[column] += weight * value;
            }
        }
    }
    Moments(sums)
}

fn horizontal(moments: &Moments, column: usize, window: &[f64; WINDOW]) -> [f64; 5] {
    let width = moments.0[0].len();
    let first = column.saturating_sub(RADIUS);
    let last = (column + RADIUS).min(width - 1);
    // Columns outside the image are zero and add nothing.
    let weights = &window[first + RADIUS - column..=last + RADIUS - column];
    std::array::from_fn(|moment| {
        moments.0[moment][first..=last]
            .iter()
            .zip(weights)
            .map(|(value, weight)| value * weight)
            .sum()
    })
}

fn similarity([mean_x, mean_y, mean_xx, mean_yy, mean_xy]: [f64; 5]) -> f64 {
    let variance_x = mean_xx - mean_x * mean_x;
    let variance_y = mean_yy - mean_y * mean_y;
    let covariance = mean_xy - mean_x * mean_y;
    ((2.0 * mean_x * mean_y + C1) * (2.0 * covariance + C2))
        / ((mean_x * mean_x + mean_y * mean_y + C1) * (variance_x + variance_y + C2))
}
