//! Times of training steps. Steps of two learners are timed in turns, because a single time is unreliable on a
//! machine with other work.

use std::time::Instant;

use omnilife_engine::schedule::Position;
use omnilife_schemas::statistics::median;

use crate::{error::ReconstructError, learner::Learner};

/// Number of timed pairs of steps.
const PAIRS: usize = 15;
/// Untimed pairs before them, which fill buffers and caches.
const WARM_UP_PAIRS: usize = 2;
/// Values below and above the range of a median. Take 15 values that are as likely to lie below the true median
/// as above it. The third and the third last enclose it with probability `1 - 2 (1 + 15 + 105) / 2^15`, 99.3 %
/// (sign test: Conover, Practical Nonparametric Statistics, 1999, section 3.2).
const BEYOND_RANGE: usize = 2;

/// Times of training steps of two learners: in every pair one step of each, right after each other, on
/// the same view.
#[derive(Debug, Clone, PartialEq)]
pub struct PairedSteps {
    /// Wall-clock seconds of both.
    pairs: Vec<[f64; 2]>,
}

/// A median, and a range that nearly always encloses the true one ([`MedianRange::of`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MedianRange {
    /// Lower end of the range.
    pub least: f64,
    /// The median.
    pub median: f64,
    /// Upper end of the range.
    pub most: f64,
}

impl MedianRange {
    /// Returns the median of values in any order, and its range: from the third value to the third last. `None`
    /// for fewer than five values.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let inner = sorted.len().checked_sub(2 * BEYOND_RANGE)?;
        let range = sorted.get(BEYOND_RANGE..BEYOND_RANGE + inner)?;
        Some(Self {
            least: *range.first()?,
            median: median(&sorted)?,
            most: *range.last()?,
        })
    }

    /// Returns true for a value outside of the range.
    pub fn excludes(self, value: f64) -> bool {
        value < self.least || self.most < value
    }
}

impl PairedSteps {
    /// Times steps of two learners in turns, with all parts that are active at the end of a schedule of
    /// `iterations`. Their order changes from pair to pair. The steps change the learners, which are of no
    /// further use.
    ///
    /// # Errors
    /// When a loss is not finite.
    pub fn measure(
        learners: [&mut dyn Learner; 2],
        (views, iterations): (usize, u64),
    ) -> Result<Self, ReconstructError> {
        let end = Position {
            iteration: 1,
            share: 1.0,
            scheduled: iterations,
        };
        let all = WARM_UP_PAIRS + PAIRS;
        let mut pairs = Vec::with_capacity(PAIRS);
        for pair in 0..all {
            let mut seconds = [0.0; 2];
            let order = if pair.is_multiple_of(2) {
                [0, 1]
            } else {
                [1, 0]
            };
            for index in order {
                let begun = Instant::now();
                learners[index].step(pair * views / all, &end)?;
                // A device may still be at work.
                learners[index].take_statistics()?;
                seconds[index] = begun.elapsed().as_secs_f64();
            }
            if pair >= WARM_UP_PAIRS {
                pairs.push(seconds);
            }
        }
        Ok(Self { pairs })
    }

    /// Returns the number of pairs of steps.
    pub fn count(&self) -> usize {
        self.pairs.len()
    }

    /// Returns the seconds of a step of the first learner and of the second.
    pub fn seconds(&self) -> [Option<MedianRange>; 2] {
        [0, 1].map(|index| {
            let seconds: Vec<f64> = self.pairs.iter().map(|pair| pair[index]).collect();
            MedianRange::of(&seconds)
        })
    }

    /// Returns the time of a step of the first learner over that of the second, from pair to pair.
    pub fn ratio(&self) -> Option<MedianRange> {
        let ratios: Vec<f64> = self.pairs.iter().map(|[a, b]| a / b).collect();
        MedianRange::of(&ratios)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paired(pairs: impl IntoIterator<Item = [f64; 2]>) -> PairedSteps {
        PairedSteps {
            pairs: pairs.into_iter().collect(),
        }
    }

    fn range(pairs: impl IntoIterator<Item = [f64; 2]>) -> MedianRange {
        paired(pairs).ratio().expect("enough pairs")
    }

    #[test]
    fn a_range_leaves_two_values_out_at_either_end() {
        let values = [7.0, -50.0, 3.0, 900.0, 4.0, 5.0, 800.0, -60.0, 6.0];
        let expected = MedianRange {
            least: 3.0,
            median: 5.0,
            most: 7.0,
        };
        assert_eq!(MedianRange::of(&values), Some(expected));
        let of_five = MedianRange::of(&values[..5]).expect("five values");
        assert_eq!((of_five.least, of_five.most), (4.0, 4.0));
        assert_eq!(MedianRange::of(&values[..4]), None);
        assert!(expected.excludes(2.9) && expected.excludes(7.1) && !expected.excludes(3.0));
    }

    /// Checks that a machine that slows down fourfold changes both steps of a pair, but hardly their ratio.
    #[test]
    fn load_that_both_steps_share_hides_no_difference() {
        let load = |pair: usize| 1.0 + 3.0 * (pair / 5) as f64;
        let pairs = (0..PAIRS).map(|pair| [0.8 * load(pair), load(pair)]);
        let measured = range(pairs.clone());
        assert!((measured.median - 0.8).abs() < 1e-12 && measured.excludes(1.0));
        let [first, second] = paired(pairs).seconds().map(|range| range.expect("enough"));
        assert!(first.most > second.least, "the times alone would not tell");
        // A few slow steps on either side change nothing.
        let hiccups = |pair: usize| match pair {
            3 | 9 => [20.0, 1.0],
            5 | 11 => [0.8, 30.0],
            _ => [0.8, 1.0],
        };
        let measured = range((0..PAIRS).map(hiccups));
        assert_eq!((measured.least, measured.most), (0.8, 0.8));
    }

    /// Checks times of the same work: sometimes one step is disturbed, sometimes the other.
    #[test]
    fn the_same_work_shows_no_direction() {
        let disturbed = |pair: usize| 1.0 + 0.02 * pair as f64;
        let measured = range((0..PAIRS).map(|pair| {
            if pair.is_multiple_of(2) {
                [disturbed(pair), 1.0]
            } else {
                [1.0, disturbed(pair)]
            }
        }));
        assert!(!measured.excludes(1.0), "{measured:?}");
        assert!(
            measured.least < 0.95 && measured.most > 1.05,
            "{measured:?}"
        );
    }
}
