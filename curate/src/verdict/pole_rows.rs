//! Are the outermost rows a single point of the sphere?

use super::{VerdictTest, median_over};
use crate::{statistics, video::Rgb8Picture};

/// Spread, in 8-bit levels, of the middle rows below which a picture is too plain to compare with.
const LEAST_SPREAD_LEVELS: f64 = 1.5;
/// A row is a pole when its spread is at most this share of that of the middle rows. The stretched
/// neighbourhood of a pole keeps some spread: tripods, stitching, compression.
const LIMIT: f64 = 0.4;

/// The north pole.
pub(super) const TOP: VerdictTest = VerdictTest {
    id: "pole-row-top",
    summary: "Spread of colours along the top row over that of the middle rows: at a pole the \
              whole row is one point.",
    limit: LIMIT,
    at_most: "the top row is nearly one colour, as at a pole",
    above: "the top row is no pole",
    measure: |_, samples| median_over(samples, |picture| relative_spread(picture, &[0])),
};

/// The south pole.
pub(super) const BOTTOM: VerdictTest = VerdictTest {
    id: "pole-row-bottom",
    summary: "The same for the bottom row.",
    limit: LIMIT,
    at_most: "the bottom row is nearly one colour, as at a pole",
    above: "the bottom row is no pole",
    measure: |_, samples| {
        median_over(samples, |picture| {
            relative_spread(picture, &[picture.height - 1])
        })
    },
};

/// The poles in the middle of top-bottom stereo.
pub(super) const MIDDLE: VerdictTest = VerdictTest {
    id: "pole-rows-middle",
    summary: "The same for the two middle rows: in top-bottom stereo the upper picture's south \
              pole meets the lower picture's north pole there.",
    limit: LIMIT,
    at_most: "the middle rows are nearly one colour each, as where two pictures meet",
    above: "the middle rows are no poles",
    measure: |_, samples| {
        median_over(samples, |picture| {
            let half = picture.height / 2;
            // One row further out each: scaling mixes the two that touch.
            relative_spread(picture, &[half.checked_sub(2)?, half + 1])
        })
    },
};

/// Largest spread of `rows` over the median spread of all rows away from them and from the edges.
fn relative_spread(picture: &Rgb8Picture, rows: &[usize]) -> Option<f64> {
    if picture.height < 16 {
        return None;
    }
    let eighth = picture.height / 8;
    let others: Vec<f64> = (eighth..picture.height - eighth)
        .filter(|y| rows.iter().all(|row| row.abs_diff(*y) >= eighth))
        .map(|y| spread(picture, y))
        .collect();
    let reference = statistics::median(&others)?;
    let largest = rows
        .iter()
        .map(|&row| spread(picture, row))
        .fold(0.0, f64::max);
    (reference >= LEAST_SPREAD_LEVELS).then_some(largest / reference)
}

/// Mean absolute deviation from the row's mean colour in 8-bit levels.
fn spread(picture: &Rgb8Picture, y: usize) -> f64 {
    let count = picture.width as f64;
    let mut mean = [0.0; 3];
    for x in 0..picture.width {
        for (sum, level) in mean.iter_mut().zip(picture.pixel(x, y)) {
            *sum += f64::from(level) / count;
        }
    }
    let mut deviation = 0.0;
    for x in 0..picture.width {
        for (mean, level) in mean.iter().zip(picture.pixel(x, y)) {
            deviation += (f64::from(level) - mean).abs();
        }
    }
    deviation / (3.0 * count)
}
