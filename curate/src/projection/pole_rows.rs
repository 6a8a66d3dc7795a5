//! Test of the outermost rows for poles: single points of the sphere.

use omnilife_schemas::statistics;
use omnilife_video::Rgb8Image;

use super::{ProjectionTest, median_over};

/// Spread, in 8-bit levels, of the middle rows below which an image is too plain to compare with.
const LEAST_SPREAD_LEVELS: f64 = 1.5;
/// A row is a pole when its spread is at most this share of that of the middle rows. The stretched
/// neighbourhood of a pole keeps some spread: tripods, stitching, compression.
const LIMIT: f64 = 0.4;

/// The north pole.
pub(super) const TOP: ProjectionTest = ProjectionTest {
    id: "pole-row-top",
    summary: "Spread of colours along the top row and their change from pixel to pixel, over \
              those of the middle rows: at a pole the whole row is one point.",
    limit: LIMIT,
    at_most: "the top row is nearly one colour, as at a pole",
    above: "the top row is not a pole",
    measure: |_, samples| median_over(samples, |image| relative_spread(image, 0)),
};

/// The south pole.
pub(super) const BOTTOM: ProjectionTest = ProjectionTest {
    id: "pole-row-bottom",
    summary: "The same for the bottom row.",
    limit: LIMIT,
    at_most: "the bottom row is nearly one colour, as at a pole",
    above: "the bottom row is not a pole",
    measure: |_, samples| median_over(samples, |image| relative_spread(image, image.height - 1)),
};

/// Returns how little a row resembles a pole: the geometric mean of its spread and of its detail, each over the median
/// of the rows away from the edges. Near a pole a row is stretched, so that its pixels differ little from their
/// neighbours; at the pole itself they do not differ at all.
fn relative_spread(image: &Rgb8Image, row: usize) -> Option<f64> {
    if image.height < 16 {
        return None;
    }
    let eighth = image.height / 8;
    let others = eighth..image.height - eighth;
    let spreads: Vec<f64> = others.clone().map(|y| spread(image, y)).collect();
    let details: Vec<f64> = others.map(|y| detail(image, y)).collect();
    let reference = statistics::median(&spreads)?;
    let detail_reference = statistics::median(&details)?;
    if reference < LEAST_SPREAD_LEVELS || detail_reference <= 0.0 {
        return None;
    }
    let product = spread(image, row) / reference * detail(image, row) / detail_reference;
    Some(product.sqrt())
}

/// Returns the mean absolute difference of neighbouring pixels of a row in 8-bit levels.
fn detail(image: &Rgb8Image, y: usize) -> f64 {
    let mut sum = 0_u64;
    for x in 0..image.width {
        let (one, next) = (image.pixel(x, y), image.pixel((x + 1) % image.width, y));
        sum += one
            .iter()
            .zip(next)
            .map(|(&p, q)| u64::from(p.abs_diff(q)))
            .sum::<u64>();
    }
    sum as f64 / (3 * image.width) as f64
}

/// Returns the mean absolute deviation from the row's mean colour in 8-bit levels.
fn spread(image: &Rgb8Image, y: usize) -> f64 {
    let count = image.width as f64;
    let mut mean = [0.0; 3];
    for x in 0..image.width {
        for (sum, level) in mean.iter_mut().zip(image.pixel(x, y)) {
            *sum += f64::from(level) / count;
        }
    }
    let mut deviation = 0.0;
    for x in 0..image.width {
        for (mean, level) in mean.iter().zip(image.pixel(x, y)) {
            deviation += (f64::from(level) - mean).abs();
        }
    }
    deviation / (3.0 * count)
}
