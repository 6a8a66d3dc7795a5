//! Test for two halves of the image with the same scene.

use omnilife_schemas::statistics;
use omnilife_video::Rgb8Image;

use super::{ProjectionTest, median_over};

/// Size of the compared blocks in pixels.
const BLOCK_WIDTH: usize = 32;
const BLOCK_HEIGHT: usize = 16;
/// Largest tested disparity, as a share of an image's width: 0.023 is 8 degrees, more than human eye distance gives for
/// anything farther than half a metre away.
const LARGEST_DISPARITY: f64 = 0.023;
/// Radius in pixels of the neighbourhood whose mean is removed before blocks are compared: plain gradients resemble
/// each other everywhere, details do not.
const DETAIL_RADIUS: usize = 4;
/// Blocks with less root mean square detail than this, in 8-bit levels, are left out.
const LEAST_DETAIL_LEVELS: f32 = 2.0;
/// Two eyes correlate by 0.8 and more, unrelated blocks by less than 0.5 at their best disparity.
const LIMIT: f64 = 0.65;

/// Left eye above right eye.
pub(super) const TOP_BOTTOM: ProjectionTest = ProjectionTest {
    id: "stereo-top-bottom",
    summary: "Median correlation of detail between blocks of the upper half and the lower half at \
              their best horizontal disparity.",
    limit: LIMIT,
    at_most: "the upper and the lower half show different things",
    above: "the upper and the lower half show the same scene",
    measure: |_, samples| median_over(samples, |image| similarity(image, Halves::TopBottom)),
};

/// Left eye beside right eye.
pub(super) const LEFT_RIGHT: ProjectionTest = ProjectionTest {
    id: "stereo-left-right",
    summary: "The same for the left and the right half.",
    limit: LIMIT,
    at_most: "the left and the right half show different things",
    above: "the left and the right half show the same scene",
    measure: |_, samples| median_over(samples, |image| similarity(image, Halves::LeftRight)),
};

#[derive(Clone, Copy)]
enum Halves {
    TopBottom,
    LeftRight,
}

fn similarity(image: &Rgb8Image, halves: Halves) -> Option<f64> {
    let detail = Detail::of(image);
    let (width, height, other) = match halves {
        Halves::TopBottom => (detail.width, detail.height / 2, (0, detail.height / 2)),
        Halves::LeftRight => (detail.width / 2, detail.height, (detail.width / 2, 0)),
    };
    let reach = (LARGEST_DISPARITY * width as f64).ceil() as usize;
    let mut best = Vec::new();
    for y in (0..(height + 1).saturating_sub(BLOCK_HEIGHT)).step_by(BLOCK_HEIGHT) {
        for x in (reach..(width + 1).saturating_sub(BLOCK_WIDTH + reach)).step_by(BLOCK_WIDTH) {
            if detail.strength(x, y) < LEAST_DETAIL_LEVELS {
                continue;
            }
            let closest = (x - reach..=x + reach)
                .map(|shifted| detail.correlation((x, y), (other.0 + shifted, other.1 + y)))
                .fold(-1.0, f32::max);
            best.push(f64::from(closest));
        }
    }
    // A handful of blocks may agree by chance.
    (best.len() >= 8)
        .then(|| statistics::median(&best))
        .flatten()
}

/// Luminance without its local mean.
struct Detail {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl Detail {
    fn of(image: &Rgb8Image) -> Self {
        let (width, height) = (image.width, image.height);
        let luminance: Vec<f32> = image
            .data
            .as_chunks::<3>()
            .0
            .iter()
            .map(|&[red, green, blue]| {
                0.299 * f32::from(red) + 0.587 * f32::from(green) + 0.114 * f32::from(blue)
            })
            .collect();
        let along_rows = running_mean(&luminance, width, height, 1, width);
        let local_mean = running_mean(&along_rows, height, width, width, 1);
        Self {
            width,
            height,
            data: luminance
                .iter()
                .zip(&local_mean)
                .map(|(value, mean)| value - mean)
                .collect(),
        }
    }

    fn block(&self, (x, y): (usize, usize)) -> impl Iterator<Item = f32> + '_ {
        (y..y + BLOCK_HEIGHT).flat_map(move |row| {
            let begin = row * self.width + x;
            self.data[begin..begin + BLOCK_WIDTH].iter().copied()
        })
    }

    fn strength(&self, x: usize, y: usize) -> f32 {
        let squares: f32 = self.block((x, y)).map(|value| value * value).sum();
        (squares / (BLOCK_WIDTH * BLOCK_HEIGHT) as f32).sqrt()
    }

    fn correlation(&self, a: (usize, usize), b: (usize, usize)) -> f32 {
        let (mut product, mut of_a, mut of_b) = (0.0, 1e-6, 1e-6);
        for (p, q) in self.block(a).zip(self.block(b)) {
            product += p * q;
            of_a += p * p;
            of_b += q * q;
        }
        product / f32::sqrt(of_a * of_b)
    }
}

/// Returns the mean over `DETAIL_RADIUS` neighbours on both sides along lines of `length` values `step` apart; the
/// lines start `stride` apart. Lines are cut off at their ends.
fn running_mean(data: &[f32], length: usize, lines: usize, step: usize, stride: usize) -> Vec<f32> {
    let mut means = vec![0.0; data.len()];
    for line in 0..lines {
        let begin = line * stride;
        for at in 0..length {
            let first = at.saturating_sub(DETAIL_RADIUS);
            let last = (at + DETAIL_RADIUS).min(length - 1);
            let sum: f32 = (first..=last).map(|k| data[begin + k * step]).sum();
            means[begin + at * step] = sum / (last - first + 1) as f32;
        }
    }
    means
}
