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

/// Local means of one row of pixels, interleaved channels, in units of bytes: x, y, x^2 + y^2 and
/// xy. The map needs no more, because only the sum of the variances appears in it.
type Moments = [Vec<f64>; 4];

/// Sum of the SSIM map over one row and all channels.
///
/// The window is separable: the rows around this one are filtered vertically into one row of
/// moments, which is filtered horizontally. Memory is a few rows whatever the image's size, and
/// every inner loop runs over contiguous values.
fn row_sum(pair: &ViewPair, row: usize, window: &[f64; WINDOW]) -> f64 {
    let [x, y, squares, products] =
        vertical_moments(pair, row, window).map(|moment| horizontal_mean(&moment, window));
    let rest = squares.iter().zip(&products);
    x.iter()
        .zip(&y)
        .zip(rest)
        .map(|((&x, &y), (&squares, &products))| similarity(x, y, squares, products))
        .sum()
}

fn vertical_moments(pair: &ViewPair, row: usize, window: &[f64; WINDOW]) -> Moments {
    let values = pair.width() * 3;
    let [mut x, mut y, mut squares, mut products]: Moments =
        std::array::from_fn(|_| vec![0.0; values]);
    for (offset, &weight) in window.iter().enumerate() {
        // Rows outside the image are zero and add nothing.
        let Some(source) = (row + offset).checked_sub(RADIUS) else {
            continue;
        };
        if source >= pair.height() {
            break;
        }
        let range = source * values..(source + 1) * values;
        let predicted = &pair.prediction()[range.clone()];
        let truth = &pair.truth()[range];
        for index in 0..values {
            let (p, t) = (f64::from(predicted[index]), f64::from(truth[index]));
            x[index] += weight * p;
            y[index] += weight * t;
            squares[index] += weight * (p * p + t * t);
            products[index] += weight * (p * t);
        }
    }
    [x, y, squares, products]
}

fn horizontal_mean(moment: &[f64], window: &[f64; WINDOW]) -> Vec<f64> {
    let values = moment.len();
    let mut means = vec![0.0; values];
    for (offset, &weight) in window.iter().enumerate() {
        // Column i of the mean takes column i + offset - RADIUS of the moment, three values each;
        // columns outside the image are zero and add nothing.
        let (to, from) = if offset < RADIUS {
            (3 * (RADIUS - offset), 0)
        } else {
            (0, 3 * (offset - RADIUS))
        };
        let (Some(means), Some(moment)) = (means.get_mut(to..), moment.get(from..)) else {
            continue;
        };
        for (mean, &value) in means.iter_mut().zip(moment) {
            *mean += weight * value;
        }
    }
    means
}

/// The map at one pixel of one channel, from local means in units of bytes.
fn similarity(x: f64, y: f64, squares: f64, products: f64) -> f64 {
    let (x, y) = (x / 255.0, y / 255.0);
    let variances = squares / (255.0 * 255.0) - (x * x + y * y);
    let covariance = products / (255.0 * 255.0) - x * y;
    ((2.0 * x * y + C1) * (2.0 * covariance + C2)) / ((x * x + y * y + C1) * (variances + C2))
}
