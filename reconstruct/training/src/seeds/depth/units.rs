//! The unit of distances, by the agreement of views: a factor on all of them, or their inverse.
//!
//! Poses of another scale than the distances, and disparities in the place of distances, leave hardly a surface on
//! which two views agree. A common factor brings them together only if it is the right one: too small a world moves
//! too far between two views, too large a one not at all.

use std::fmt;

use omnilife_schemas::{distances::DistanceImage, statistics::median};

use super::{
    lift::DistanceView,
    pairs::{ScaledViews, Sighting, share_apart, shown, with_distances},
};

/// Maximum number of compared pairs.
const MOST_PAIRS: usize = 12;
const LEAST_PAIRS: usize = 3;
/// Number of pixels of all compared pairs, above which there are fewer pairs.
const MOST_PIXELS: usize = 2_000_000;
/// Distances in doubt are those on which views disagree at more than this share of the places.
const DOUBTFUL_SHARE: f64 = 0.15;
/// Another reading is named where views disagree at less than this share of the places, and at less than the second
/// times the share without it.
const AGREEING_SHARE: f64 = 0.25;
const BETTER_SHARE: f64 = 0.4;
/// Tested logarithms of factors: the largest on both sides, and the steps between them.
const LARGEST_LOG: f64 = 7.0;
const LOG_STEP: f64 = 0.1;
const FINE_STEP: f64 = 0.01;
/// Logarithm of the factor to a world so large that views hardly move in it.
const MUCH_LARGER_LOG: f64 = 3.0;

/// A way to read numbers as distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// The numbers times a factor.
    Times(f64),
    /// A factor over the numbers.
    Over(f64),
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Times(factor) => write!(f, "times about {factor:.3}"),
            // Its factor is in normalized units, which nobody outside knows.
            Self::Over(_) => f.write_str("read as disparities"),
        }
    }
}

/// A reading under which views agree that disagree without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherUnit {
    /// Share of the places at which views disagree, as the distances are.
    pub as_given: f64,
    /// The same with the reading.
    pub otherwise: f64,
    /// The better reading; a factor is in units of the given distances.
    pub reading: Reading,
}

/// Finds a unit under which views agree far better. `None` where they agree as they are, where no other unit is clearly
/// better, and where views share too few places.
pub fn other_unit(views: &[DistanceView<'_>]) -> Option<OtherUnit> {
    let pixels = views.first()?.distances.values.len();
    let pairs = pairs(views.len(), pixels);
    let as_given = share_apart(&log_ratios(views, &pairs, 0.0))?;
    if as_given <= DOUBTFUL_SHARE {
        return None;
    }
    let inverse = with_distances(views, inverted);
    let factor = best_factor(views, &pairs);
    let over = best_factor(&shown(views, &inverse), &pairs);
    let found = [
        factor.map(|(log, share)| (Reading::Times(log.exp()), share)),
        over.map(|(log, share)| (Reading::Over(log.exp()), share)),
    ];
    let best = found.into_iter().flatten();
    let (reading, otherwise) = best.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    (otherwise < AGREEING_SHARE && otherwise < BETTER_SHARE * as_given).then_some(OtherUnit {
        as_given,
        otherwise,
        reading,
    })
}

/// Returns pairs of views a quarter, a half and three quarters of all apart: neighbours hardly move. Of large images
/// there are fewer.
fn pairs(count: usize, pixels: usize) -> Vec<[usize; 2]> {
    let apart = |quarters: usize| {
        let gap = (quarters * count / 4).max(1);
        (gap..count).map(move |second| [second - gap, second])
    };
    let all: Vec<[usize; 2]> = (1..=3).flat_map(apart).collect();
    let most = (MOST_PIXELS / pixels.max(1)).clamp(LEAST_PAIRS, MOST_PAIRS);
    let step = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(step).collect()
}

fn inverted(view: &DistanceView<'_>) -> DistanceImage {
    let values = view.distances.values.iter();
    let inverse = |&value: &f32| if value > 0.0 { 1.0 / value } else { value };
    DistanceImage {
        values: values.map(inverse).collect(),
        ..view.distances.clone()
    }
}

/// Returns the differences of the distances at places that both views of a pair see, as logarithms.
fn log_ratios(views: &[DistanceView<'_>], pairs: &[[usize; 2]], log_factor: f64) -> Vec<f64> {
    let log_scales = vec![log_factor; views.len()];
    let scaled = ScaledViews {
        views,
        log_scales: &log_scales,
    };
    let sightings = scaled.of_some(pairs, |_, _, sightings: Vec<Sighting>| -> Vec<f64> {
        sightings.iter().map(|one| one.log_ratio.abs()).collect()
    });
    sightings.concat()
}

/// Returns the logarithm of the factor with which views agree best, and the share of places at which they disagree then.
/// `None` where a much larger world is hardly worse: then nothing tells its size.
fn best_factor(views: &[DistanceView<'_>], pairs: &[[usize; 2]]) -> Option<(f64, f64)> {
    let steps = (2.0 * LARGEST_LOG / LOG_STEP) as usize;
    let tested: Vec<(f64, f64)> = (0..=steps)
        .map(|step| step as f64 * LOG_STEP - LARGEST_LOG)
        .filter_map(|log| Some((log, share_apart(&log_ratios(views, pairs, log))?)))
        .collect();
    let &(coarse, share) = tested.iter().min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let endless = share_apart(&log_ratios(views, pairs, coarse + MUCH_LARGER_LOG))?;
    if share > BETTER_SHARE * endless {
        return None;
    }
    let fine = (-15..=15).map(|step| f64::from(step).mul_add(FINE_STEP, coarse));
    let off = |log: f64| median(&log_ratios(views, pairs, log)).unwrap_or(f64::INFINITY);
    let log = fine.min_by(|&a, &b| off(a).total_cmp(&off(b)))?;
    Some((log, share))
}
