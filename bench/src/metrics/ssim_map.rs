//! SSIM of every pixel (Wang, Bovik, Sheikh and Simoncelli 2004) under an 11x11 Gaussian window of
//! sigma 1.5, with C1 = 0.01^2 and C2 = 0.03^2 for values in [0, 1].

use rayon::prelude::*;

/// Pixels from the centre of the window to its edge.
pub(super) const RADIUS: usize = 5;
/// Side of the window in pixels.
pub(super) const WINDOW: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Factor n / (n - 1) for the 121 pixels of a window: it makes biased moments unbiased.
const UNBIASED: f64 = (WINDOW * WINDOW) as f64 / (WINDOW * WINDOW - 1) as f64;

/// The map of an image pair, in the three published conventions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SsimMap {
    /// Mean over the channels for every pixel, row-major: biased moments, zeros around the image.
    pub(super) zero_padded: Vec<f64>,
    /// Mean over channels and the pixels whose window lies within the image, with unbiased moments; `None` if no window
    /// does.
    pub(super) valid_mean: Option<f64>,
    /// The same with biased moments.
    pub(super) valid_biased_mean: Option<f64>,
}

impl SsimMap {
    /// Computes the map of images of `height * width * 3` values in [0, 1], row-major; `counted` marks the pixels of
    /// the means, `None` for all.
    pub(super) fn new(
        [width, height]: [usize; 2],
        [prediction, truth]: [&[f64]; 2],
        counted: Option<&[bool]>,
    ) -> Self {
        let window = gaussian_window();
        // Sums of rows are collected and added in order, so that scores do not depend on the scheduling.
        let rows: Vec<Row> = (0..height)
            .into_par_iter()
            .map(|row| {
                let counted = counted.map(|counted| &counted[row * width..(row + 1) * width]);
                row_of_map(
                    [width, height],
                    [prediction, truth],
                    (row, counted),
                    &window,
                )
            })
            .collect();
        let pixels: usize = rows.iter().map(|row| row.valid_pixels).sum();
        let mean = |sum: fn(&Row) -> f64| {
            let all: f64 = rows.iter().map(sum).sum();
            (pixels > 0).then(|| all / (3 * pixels) as f64)
        };
        Self {
            valid_mean: mean(|row| row.valid_sum),
            valid_biased_mean: mean(|row| row.valid_biased_sum),
            zero_padded: rows.into_iter().flat_map(|row| row.zero_padded).collect(),
        }
    }
}

struct Row {
    zero_padded: Vec<f64>,
    valid_sum: f64,
    valid_biased_sum: f64,
    /// Number of pixels in the sums.
    valid_pixels: usize,
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

/// Local means of one row of pixels, interleaved channels: x, y, x^2 + y^2 and xy. The map needs
/// no more, because only the sum of the variances appears in it.
type Moments = [Vec<f64>; 4];

/// Computes a row of the map. The window is separable: the rows around this one are filtered vertically into one row of
/// moments, which is filtered horizontally. Memory is a few rows for any size of images, and every inner loop runs over
/// contiguous values.
fn row_of_map(
    [width, height]: [usize; 2],
    images: [&[f64]; 2],
    (row, counted): (usize, Option<&[bool]>),
    window: &[f64; WINDOW],
) -> Row {
    let moments = vertical_moments([width, height], images, row, window);
    let [x, y, squares, products] = moments.map(|moment| horizontal_mean(&moment, window));
    let at = |index: usize, factor| {
        similarity(x[index], y[index], squares[index], products[index], factor)
    };
    let zero_padded = (0..width)
        .map(|column| (0..3).map(|c| at(3 * column + c, 1.0)).sum::<f64>() / 3.0)
        .collect();
    let is_valid = row >= RADIUS && row + RADIUS < height && width > 2 * RADIUS;
    let columns = if is_valid {
        RADIUS..width - RADIUS
    } else {
        0..0
    };
    let columns = columns.filter(|&column| counted.is_none_or(|counted| counted[column]));
    let values = || {
        columns
            .clone()
            .flat_map(|column| 3 * column..3 * column + 3)
    };
    Row {
        zero_padded,
        valid_sum: values().map(|index| at(index, UNBIASED)).sum(),
        valid_biased_sum: values().map(|index| at(index, 1.0)).sum(),
        valid_pixels: columns.clone().count(),
    }
}

#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn vertical_moments(
    [width, height]: [usize; 2],
    [prediction, truth]: [&[f64]; 2],
    row: usize,
    window: &[f64; WINDOW],
) -> Moments {
    let values = width * 3;
    let [mut x, mut y, mut squares, mut products]: Moments =
        std::array::from_fn(|_| vec![0.0; values]);
    for (offset, &weight) in window.iter().enumerate() {
        // Rows outside the image are zero and add nothing.
        let Some(source) = (row + offset).checked_sub(RADIUS) else {
            continue;
        };
        if source >= height {
            break;
        }
        let range = source * values..(source + 1) * values;
        let predicted = &prediction[range.clone()];
        let truth = &truth[range];
        for index in 0..values {
            let (p, t) = (predicted[index], truth[index]);
            x[index] += weight * p;
            y[index] += weight * t;
            squares[index] += weight * (p * p + t * t);
            products[index] += weight * (p * t);
        }
    }
    [x, y, squares, products]
}

#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
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

/// Returns the map at one pixel of one channel, from local means; variances and covariance are taken times `factor`.
#[inline(always)]
fn similarity(x: f64, y: f64, squares: f64, products: f64, factor: f64) -> f64 {
    let variances = factor * (squares - (x * x + y * y));
    let covariance = factor * (products - x * y);
    ((2.0 * x * y + C1) * (2.0 * covariance + C2)) / ((x * x + y * y + C1) * (variances + C2))
}
