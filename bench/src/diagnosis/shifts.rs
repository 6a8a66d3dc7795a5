//! Detection of views shifted by up to a few pixels, for example with pixel centres at corners.

use std::ops::Range;

use omnilife_schemas::statistics::median;

use super::{
    geometry::vertex,
    images::{least, mean, psnr_db},
    look::ViewFacts,
};
use crate::metrics::ViewPair;

/// Parts of the longitudes (or of the width) and of the rows that are examined separately.
const COLUMNS: usize = 4;
const ROWS: usize = 2;
/// Largest detectable shift, pixels.
const REACH: i64 = 6;
/// Least number of rows of an examined image.
const LEAST_HEIGHT: usize = 64;
/// Least shift of a finding, pixels.
const TELLING_PIXELS: f64 = 0.35;
/// Least share of the parts of all views with a known shift.
const KNOWN: f64 = 0.75;
/// A view of another camera is shifted too, but differently in every part of the image and in every view. Medians of
/// most views and of most parts must lie this near to the median of all, pixels.
const AGREEING_VIEW_PIXELS: f64 = 0.3;
const AGREEING_PART_PIXELS: f64 = 0.35;
const AGREEING_VIEWS: f64 = 0.8;
const AGREEING_PARTS: f64 = 0.75;
/// Least gain in dB of every view by a shift: a shift without a gain is not a mistake of convention.
const TELLING_GAIN_DB: f64 = 0.2;

/// Returns the shift (right, down) in pixels of every part of a prediction against the ground truth, row by row; `None`
/// if it cannot be determined. Columns wrap if `wraps` is true. Small images have no parts.
pub(super) fn by_part(pair: &ViewPair, wraps: bool) -> Vec<Option<[f64; 2]>> {
    let [width, height] = pair.size();
    if height < LEAST_HEIGHT || width < LEAST_HEIGHT {
        return Vec::new();
    }
    let truth = smoothed(pair.truth(), pair.size());
    let mut predicted = smoothed(pair.prediction(), pair.size());
    match_exposure(&mut predicted, &truth);
    let images = SmoothedPair {
        pair,
        predicted: padded(&predicted, width),
        truth,
    };
    // The poles of a panorama have no longitude.
    let (rows, columns) = if wraps {
        (height / 8..height - height / 8, 0..width)
    } else {
        let margin = REACH as usize;
        (margin..height - margin, margin..width - margin)
    };
    let part = |range: &Range<usize>, index: usize, parts: usize| {
        let at = |index: usize| range.start + index * range.len() / parts;
        at(index)..at(index + 1)
    };
    let parts = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
    parts
        .map(|(row, column)| {
            images.shift(&Part {
                rows: part(&rows, row, ROWS),
                columns: part(&columns, column, COLUMNS),
            })
        })
        .collect()
}

/// A rectangle of pixels.
struct Part {
    rows: Range<usize>,
    columns: Range<usize>,
}

/// Both images of a pair in grey, without their finest detail, which contains noise and would make a blur of a shift by
/// half a pixel.
struct SmoothedPair<'a> {
    pair: &'a ViewPair,
    /// Padded by the reach.
    predicted: Vec<f32>,
    truth: Vec<f32>,
}

impl SmoothedPair<'_> {
    /// Returns the shift of the prediction in a part: first along the rows, then along the columns, then along the rows
    /// again.
    fn shift(&self, part: &Part) -> Option<[f64; 2]> {
        let along =
            |error: &dyn Fn(i64) -> f64| -> Vec<f64> { (-REACH..=REACH).map(error).collect() };
        let lowest = |errors: &[f64]| {
            let at = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            at.map_or(0, |at| at as i64 - REACH)
        };
        let right = lowest(&along(&|right| self.error(part, [right, 0])));
        let by_row = along(&|down| self.error(part, [right, down]));
        let down = lowest(&by_row);
        let by_column = along(&|right| self.error(part, [right, down]));
        Some([vertex(&by_column)?, vertex(&by_row)?])
    }

    /// Returns the mean squared error in a part of the prediction moved back by whole pixels, up to the reach.
    fn error(&self, part: &Part, [right, down]: [i64; 2]) -> f64 {
        let [width, height] = self.pair.size();
        let (mut sum, mut count) = (0.0, 0_usize);
        for row in part.rows.clone() {
            let other_row = (row as i64 + down).clamp(0, height as i64 - 1) as usize;
            let start = other_row * (width + 2 * REACH as usize) + (right + REACH) as usize;
            let predicted = &self.predicted[start..][part.columns.clone()];
            let truth = &self.truth[row * width..][part.columns.clone()];
            let pixels = predicted.iter().zip(truth).zip(part.columns.clone());
            for ((predicted, truth), column) in pixels {
                if self.pair.counts(row * width + column) {
                    let difference = predicted - truth;
                    sum += f64::from(difference * difference);
                    count += 1;
                }
            }
        }
        sum / count.max(1) as f64
    }
}

/// Gives an image the mean and the deviation of another one: a darker image would fit better a little to the side,
/// where it is brighter.
fn match_exposure(image: &mut [f32], other: &[f32]) {
    let moments = |values: &[f32]| {
        let average = mean(values.iter().copied().map(f64::from));
        let squares = values
            .iter()
            .map(|&value| (f64::from(value) - average).powi(2));
        (average, mean(squares).sqrt())
    };
    let [(from, deviation), (to, wanted)] = [moments(image), moments(other)];
    let gain = wanted / deviation.max(1e-6);
    for value in image {
        *value = ((f64::from(*value) - from) * gain + to) as f32;
    }
}

/// Returns an image of rows of `width` values with the values of the other end before and behind every row.
fn padded(image: &[f32], width: usize) -> Vec<f32> {
    let reach = REACH as usize;
    let rows = image.chunks_exact(width);
    rows.flat_map(|row| [&row[width - reach..], row, &row[..reach]].concat())
        .collect()
}

/// Returns grey values under a binomial filter of 5 x 5 pixels; columns wrap, rows end.
fn smoothed(bytes: &[u8], [width, height]: [usize; 2]) -> Vec<f32> {
    const WEIGHTS: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
    let grey = |pixel: &[u8; 3]| pixel.iter().map(|&byte| f32::from(byte)).sum::<f32>() / 3.0;
    let grey: Vec<f32> = bytes.as_chunks::<3>().0.iter().map(grey).collect();
    let mut across = vec![0.0; grey.len()];
    for (smooth, row) in across.chunks_exact_mut(width).zip(grey.chunks_exact(width)) {
        for (column, value) in smooth.iter_mut().enumerate() {
            let taps = WEIGHTS.iter().enumerate();
            *value = taps
                .map(|(tap, weight)| weight * row[(column + width + tap - 2) % width])
                .sum();
        }
    }
    let mut out = vec![0.0; grey.len()];
    for (row, smooth) in out.chunks_exact_mut(width).enumerate() {
        for (tap, weight) in WEIGHTS.iter().enumerate() {
            let other = (row + tap).saturating_sub(2).min(height - 1);
            for (value, from) in smooth.iter_mut().zip(&across[other * width..]) {
                *value += weight * from;
            }
        }
    }
    out
}

/// Returns the shift (right, down) of the views in half pixels, if all share one.
pub(super) fn common(views: &[ViewFacts]) -> Option<[i32; 2]> {
    let by_view: Vec<&[Option<[f64; 2]>]> = views.iter().map(|view| &view.shifts[..]).collect();
    let parts = by_view.first()?.len();
    let all: Vec<[f64; 2]> = by_view
        .iter()
        .copied()
        .flatten()
        .flatten()
        .copied()
        .collect();
    if parts == 0 || (all.len() as f64) < KNOWN * (parts * views.len()) as f64 {
        return None;
    }
    let middle = medians(&all)?;
    let is_near = |found: &[[f64; 2]], pixels: f64| {
        medians(found).is_some_and(|found| {
            let mut apart = found.iter().zip(&middle).map(|(a, b)| (a - b).abs());
            apart.all(|apart| apart <= pixels)
        })
    };
    let views_near = by_view.iter().filter(|view| {
        let known: Vec<[f64; 2]> = view.iter().copied().flatten().collect();
        is_near(&known, AGREEING_VIEW_PIXELS)
    });
    let parts_near = (0..parts).filter(|&part| {
        let known: Vec<[f64; 2]> = by_view.iter().filter_map(|view| view[part]).collect();
        is_near(&known, AGREEING_PART_PIXELS)
    });
    let agrees = views_near.count() as f64 >= AGREEING_VIEWS * views.len() as f64
        && parts_near.count() as f64 >= AGREEING_PARTS * parts as f64;
    let tells = middle.iter().any(|pixels| pixels.abs() >= TELLING_PIXELS);
    (agrees && tells).then(|| middle.map(|pixels| (2.0 * pixels).round() as i32))
}

/// Returns medians of both coordinates; `None` without values.
fn medians(found: &[[f64; 2]]) -> Option<[f64; 2]> {
    let of = |axis: usize| median(&found.iter().map(|shift| shift[axis]).collect::<Vec<_>>());
    Some([of(0)?, of(1)?])
}

/// Returns the gain in dB of a prediction that is moved back by half pixels (right, down).
pub(super) fn gain_db(pair: &ViewPair, half_pixels: [i32; 2]) -> f64 {
    let [width, height] = pair.size().map(|side| side as i64);
    // Between two pixels their mean is taken.
    let [columns, rows] = half_pixels.map(|half| {
        let half = i64::from(half);
        [half.div_euclid(2), half.div_euclid(2) + half.rem_euclid(2)]
    });
    let bytes = pair.prediction();
    let [mut before, mut after] = [0.0; 2];
    for row in 0..height {
        let taken = rows.map(|down| (row + down).clamp(0, height - 1) * width);
        for column in 0..width {
            let pixel = (row * width + column) as usize;
            if !pair.counts(pixel) {
                continue;
            }
            let from = columns.map(|right| (column + right).rem_euclid(width));
            for channel in 0..3 {
                let truth = f64::from(pair.truth()[3 * pixel + channel]);
                let at =
                    |row: i64, column: i64| f64::from(bytes[3 * (row + column) as usize + channel]);
                let moved = taken.map(|row| from.map(|column| at(row, column)));
                let moved = 0.25 * moved.as_flattened().iter().sum::<f64>();
                before += (at(row * width, column) - truth).powi(2);
                after += (moved - truth).powi(2);
            }
        }
    }
    let values = (3 * width * height) as f64;
    psnr_db(after / values) - psnr_db(before / values)
}

/// Returns the mean gain in dB of views by a shift, if every one gains.
pub(super) fn telling_gain(gains: &[f64]) -> Option<f64> {
    let tells = !gains.is_empty() && least(gains.iter().copied()) >= TELLING_GAIN_DB;
    tells.then(|| mean(gains.iter().copied()))
}
