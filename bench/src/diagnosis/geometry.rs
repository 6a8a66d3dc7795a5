//! Detection of rotated, mirrored or upside-down views.

use super::{
    images::{Small, correlation, least, mean},
    look::ViewFacts,
};

/// Least mean gain in dB for a finding: a wrong convention costs many.
const TELLING_GAIN_DB: f64 = 1.0;
/// Least correlation of the rotated views' grey values with the ground truth's, on the mean over the views, and its
/// least gain: for two unrelated images some rotation is always better. In a nearly symmetrical scene at most half of
/// the difference to 1 may remain.
const LEAST_CORRELATION: f64 = 0.4;
const LEAST_CORRELATION_GAIN: f64 = 0.15;
const LEFT_OF_MISSING: f64 = 0.5;
/// A smaller rotation may be a shift of pixels.
const SMALL_DEGREES: f64 = 10.0;
/// Least share of the views with this best rotation, within one column of the reduced image: a rotating camera gives
/// every view another angle.
const AGREEING_VIEWS: f64 = 0.8;

/// The change that undoes a wrong orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turn {
    /// Columns in reverse.
    pub(super) is_mirrored: bool,
    /// Rows in reverse.
    pub(super) is_upside_down: bool,
    /// Then moved to the right, degrees in (-180, 180]; 0 where columns do not wrap.
    pub(super) degrees_right: f64,
}

impl Turn {
    /// Returns true if it may be a shift by pixels.
    pub(super) fn is_small(self) -> bool {
        !self.is_mirrored && !self.is_upside_down && self.degrees_right.abs() < SMALL_DEGREES
    }
}

/// Returns the rotation that makes the views much better, with the mean gain in dB; `wraps` if columns do.
pub(super) fn turn(views: &[ViewFacts], wraps: bool) -> Option<(Turn, f64)> {
    let mut best: Option<Candidate> = None;
    for is_mirrored in [false, true] {
        for is_upside_down in [false, true] {
            let candidate = Candidate::of(views, [is_mirrored, is_upside_down], wraps)?;
            if best.as_ref().is_none_or(|best| candidate.gain > best.gain) {
                best = Some(candidate);
            }
        }
    }
    let best = best?;
    // Less than a column is left to shifts.
    let is_change = best.flips != [false; 2] || best.columns != 0;
    (is_change && best.is_telling(views)).then(|| {
        let turn = Turn {
            is_mirrored: best.flips[0],
            is_upside_down: best.flips[1],
            degrees_right: if wraps { best.degrees(views) } else { 0.0 },
        };
        (turn, best.gain)
    })
}

/// The best shift of the columns after mirroring.
struct Candidate {
    /// Columns in reverse, rows in reverse.
    flips: [bool; 2],
    /// Columns to the right.
    columns: usize,
    /// Mean over the views, dB.
    gain: f64,
    /// Gains of the views, dB, by columns.
    by_view: Vec<Vec<f64>>,
}

impl Candidate {
    /// Returns `None` without views.
    fn of(views: &[ViewFacts], flips: [bool; 2], wraps: bool) -> Option<Self> {
        let gains = |view: &ViewFacts| -> Vec<f64> {
            let small = &view.small;
            let image = flipped(&small.predicted, small.size[0], flips);
            let before = small.psnr_of(&small.predicted);
            let shifts = if wraps { small.size[0] } else { 1 };
            (0..shifts)
                .map(|columns| small.psnr_of(&moved(&image, small.size[0], columns)) - before)
                .collect()
        };
        let by_view: Vec<Vec<f64>> = views.iter().map(gains).collect();
        let of = |columns: usize| mean(by_view.iter().map(|gains| gains[columns]));
        let columns = (0..by_view.first()?.len()).max_by(|&a, &b| {
            // The first of equals.
            of(a).total_cmp(&of(b)).then(b.cmp(&a))
        })?;
        Some(Self {
            flips,
            columns,
            gain: of(columns),
            by_view,
        })
    }

    fn is_telling(&self, views: &[ViewFacts]) -> bool {
        if self.gain < TELLING_GAIN_DB
            || least(self.by_view.iter().map(|gains| gains[self.columns])) <= 0.0
        {
            return false;
        }
        let agrees = |gains: &Vec<f64>| {
            let own = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b]));
            let apart = own.unwrap_or(0).abs_diff(self.columns);
            apart.min(gains.len() - apart) <= 1
        };
        let agreeing = self.by_view.iter().filter(|gains| agrees(gains)).count();
        let likeness = |image: &[f32], small: &Small| {
            let grey = |[red, green, blue]: [f64; 3]| red + green + blue;
            let image = small.counted_pixels(image).map(grey);
            correlation(image, small.counted_pixels(&small.truth).map(grey))
        };
        let before = mean((views.iter()).map(|view| likeness(&view.small.predicted, &view.small)));
        let after = mean(views.iter().map(|view| {
            let width = view.small.size[0];
            let image = flipped(&view.small.predicted, width, self.flips);
            likeness(&moved(&image, width, self.columns), &view.small)
        }));
        agreeing as f64 >= AGREEING_VIEWS * views.len() as f64
            && after >= LEAST_CORRELATION
            && (after - before >= LEAST_CORRELATION_GAIN
                || 1.0 - after <= LEFT_OF_MISSING * (1.0 - before))
    }

    /// Refines the shift of the columns at the larger of the reduced sizes.
    fn degrees(&self, views: &[ViewFacts]) -> f64 {
        let Some(first) = views.first() else {
            return 0.0;
        };
        let [small, medium] = [first.small.size[0], first.medium.size[0]];
        let step = medium.div_ceil(small);
        let centre = (self.columns * medium + small / 2) / small;
        let images: Vec<Vec<f32>> = (views.iter())
            .map(|view| flipped(&view.medium.predicted, medium, self.flips))
            .collect();
        let error = |columns: usize| {
            let pairs = views.iter().zip(&images);
            mean(pairs.map(|(view, image)| {
                let medium = &view.medium;
                let image = moved(image, medium.size[0], columns % medium.size[0]);
                medium.error_between(&image, &medium.truth)
            }))
        };
        // One column beyond the largest error of the small image, on either side.
        let reach = step + 1;
        let errors: Vec<f64> = (0..=2 * reach)
            .map(|at| error(centre + medium + at - reach))
            .collect();
        let columns = centre as f64 + vertex(&errors).unwrap_or(0.0);
        let degrees = 360.0 * columns / medium as f64;
        if degrees > 180.0 {
            degrees - 360.0
        } else {
            degrees
        }
    }
}

/// Returns the place of the minimum of errors at equal steps, by the parabola through the least and its neighbours, in
/// steps from the middle one. `None` if the least is the first or the last.
pub(super) fn vertex(errors: &[f64]) -> Option<f64> {
    let at = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]))?;
    let [left, here, right] = *errors.get(at.checked_sub(1)?..at + 2)? else {
        return None;
    };
    let curvature = left - 2.0 * here + right;
    let offset = at as f64 - (errors.len() / 2) as f64;
    (curvature > 0.0).then(|| offset + 0.5 * (left - right) / curvature)
}

/// Returns an image of rows of `width` pixels with its columns, its rows, or both in reverse.
fn flipped(image: &[f32], width: usize, [columns, rows]: [bool; 2]) -> Vec<f32> {
    let mut pixels: Vec<[f32; 3]> = image.as_chunks::<3>().0.to_vec();
    if rows {
        // Reversing all pixels reverses both.
        pixels.reverse();
    }
    if rows != columns {
        pixels.chunks_exact_mut(width).for_each(<[_]>::reverse);
    }
    pixels.concat()
}

/// Returns an image of rows of `width` pixels with its columns moved to the right by less than that.
fn moved(image: &[f32], width: usize, columns: usize) -> Vec<f32> {
    let mut image = image.to_vec();
    for row in image.chunks_exact_mut(3 * width) {
        row.rotate_right(3 * columns);
    }
    image
}
