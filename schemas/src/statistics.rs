//! Order statistics of numbers, and the frame interval of a clip.

use std::cmp::Ordering;

/// A number with a total order, NaN last: `f32` and `f64`.
pub trait Real: Copy {
    /// The order of IEEE 754, as `f64::total_cmp`.
    fn total_order(&self, other: &Self) -> Ordering;
}

impl Real for f32 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Real for f64 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// Quantile `share` in [0, 1] (nearest rank, NaN sorted last) of values in any order; `None` of
/// none.
pub fn quantile<T: Real>(values: &[T], share: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let rank = (share * last as f64).round() as usize;
    let mut values = values.to_vec();
    let (_, value, _) = values.select_nth_unstable_by(rank.min(last), T::total_order);
    Some(*value)
}

/// Median of values in any order; `None` of none. Of an even count it is the upper one of the two in
/// the middle, so that it is always one of the values.
pub fn median<T: Real>(values: &[T]) -> Option<T> {
    quantile(values, 0.5)
}

/// Quantile `share` in [0, 1] of the values whose times lie within `reach_seconds` of that of
/// `index`. `times` is sorted and as long as `values`.
pub fn local_quantile(
    times: &[f64],
    values: &[f32],
    index: usize,
    reach_seconds: f64,
    share: f64,
) -> f32 {
    let centre = times[index];
    let first = times.partition_point(|&time| time < centre - reach_seconds);
    let last = times.partition_point(|&time| time <= centre + reach_seconds);
    quantile(&values[first..last], share).unwrap_or(values[index])
}

/// Median distance of consecutive timestamps in the unit of the times; `None` below two of them.
pub fn frame_interval(times: &[f64]) -> Option<f64> {
    let intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    median(&intervals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!(median(&values), Some(3.0));
        assert_eq!(quantile(&values, 0.9), Some(5.0));
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(median::<f64>(&[]), None);
    }

    #[test]
    fn the_median_of_an_even_count_is_the_upper_one_in_the_middle() {
        for count in [2, 4, 10, 256] {
            let values: Vec<f32> = (0..count).rev().map(|value| value as f32).collect();
            assert_eq!(median(&values), Some((count / 2) as f32));
        }
    }

    #[test]
    fn nan_sorts_last() {
        assert_eq!(median(&[f32::NAN, 1.0, 0.0]), Some(1.0));
    }

    #[test]
    fn local_quantiles_see_only_their_window() {
        let times = [0.0, 1.0, 2.0, 3.0, 100.0];
        let values = [1.0, 2.0, 3.0, 4.0, 99.0];
        assert_eq!(local_quantile(&times, &values, 1, 1.0, 0.5), 2.0);
        assert_eq!(local_quantile(&times, &values, 4, 1.0, 0.5), 99.0);
    }

    #[test]
    fn the_frame_interval_is_that_of_most_frames() {
        assert_eq!(frame_interval(&[0.0, 0.5, 1.0, 1.5, 9.0]), Some(0.5));
        assert_eq!(frame_interval(&[1.0]), None);
        assert_eq!(frame_interval(&[]), None);
    }
}
