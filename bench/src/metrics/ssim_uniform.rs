//! `ssim-skimage-uniform`: structural similarity as in scikit-image with default options.

use omnilife_schemas::records::Direction;

use super::{Metric, Undefined};

/// SSIM as Neural Atlas Graphs and its peers on driving scenes publish it.
pub(super) const METRIC: Metric = Metric {
    id: "ssim-skimage-uniform",
    title: "SSIM (scikit-image, uniform)",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [-1.0, 1.0],
    source: "scikit-image's structural_similarity with its defaults and data_range 1: a uniform window of \
             7x7, sample covariance (moments times 49/48), mean over channels and the pixels at least 3 \
             from the border, 8-bit images in [0, 1] (Neural Atlas Graphs scripts/eval_metrics.py); \
             undefined below 7x7 pixels",
    needs: &[],
    function: |sample| {
        let [prediction, truth] = sample.pair.unit_values();
        of_images(
            [&prediction, &truth],
            sample.pair.size(),
            sample.pair.counted(),
        )
        .ok_or(TOO_SMALL)
    },
};

/// Reason why an image has no such score.
const TOO_SMALL: Undefined = Undefined("the image is smaller than 7x7 pixels");
/// Pixels of the window across.
const WINDOW: usize = 7;
/// Constants of the definition for values in [0, 1].
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Returns the mean over the windows of two images of three channels in [0, 1], row by row. The middle of each window
/// is a counted pixel (all are, without `counted`); `None` if no such window fits.
pub(super) fn of_images(
    [x, y]: [&[f64]; 2],
    [width, height]: [usize; 2],
    counted: Option<&[bool]>,
) -> Option<f64> {
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let across = width + 1 - WINDOW;
    let middle = |at: usize| (at / across + WINDOW / 2) * width + at % across + WINDOW / 2;
    let all = across * (height + 1 - WINDOW);
    let counted: Vec<usize> = (0..all)
        .filter(|&at| counted.is_none_or(|counted| counted[middle(at)]))
        .collect();
    if counted.is_empty() {
        return None;
    }
    let mut sum = 0.0;
    for channel in 0..3 {
        let of = |image: &[f64], at: usize| image[3 * at + channel];
        let means = [
            windows(width, height, |at| of(x, at)),
            windows(width, height, |at| of(y, at)),
            windows(width, height, |at| of(x, at) * of(x, at)),
            windows(width, height, |at| of(y, at) * of(y, at)),
            windows(width, height, |at| of(x, at) * of(y, at)),
        ];
        let count = (WINDOW * WINDOW) as f64;
        let sample = count / (count - 1.0);
        for &at in &counted {
            let [ux, uy, uxx, uyy, uxy] = means.each_ref().map(|means| means[at]);
            let (vx, vy) = (sample * (uxx - ux * ux), sample * (uyy - uy * uy));
            let vxy = sample * (uxy - ux * uy);
            sum += (2.0 * ux * uy + C1) * (2.0 * vxy + C2)
                / ((ux * ux + uy * uy + C1) * (vx + vy + C2));
        }
    }
    Some(sum / (3 * counted.len()) as f64)
}

/// Means over all windows that fit, row by row.
fn windows(width: usize, height: usize, value: impl Fn(usize) -> f64) -> Vec<f64> {
    let across = width + 1 - WINDOW;
    let rows: Vec<f64> = (0..height)
        .flat_map(|row| {
            let value = &value;
            (0..across).map(move |column| {
                let first = row * width + column;
                (first..first + WINDOW).map(value).sum::<f64>()
            })
        })
        .collect();
    let down = height + 1 - WINDOW;
    (0..across * down)
        .map(|at| {
            let column_sum: f64 = (0..WINDOW).map(|row| rows[at + row * across]).sum();
            column_sum / (WINDOW * WINDOW) as f64
        })
        .collect()
}
