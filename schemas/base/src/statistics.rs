//! Order statistics of numbers, robust deviations and weights, and the frame interval of a clip.

use std::cmp::Ordering;

/// Numbers with a total order, NaN last: `f32` and `f64`.
pub trait Real: Copy {
    /// Compares by the order of IEEE 754, as `f64::total_cmp`.
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

/// Returns the quantile `share` in [0, 1] (nearest rank, NaN sorted last) of values in any order; `None` without
/// values.
pub fn quantile<T: Real>(values: &[T], share: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let rank = (share * last as f64).round() as usize;
    let mut values = values.to_vec();
    let (_, value, _) = values.select_nth_unstable_by(rank.min(last), T::total_order);
    Some(*value)
}

/// Returns the median of values in any order; `None` without values. With an even count it is the upper one of the
/// two in the middle, so that it is always one of the values.
pub fn median<T: Real>(values: &[T]) -> Option<T> {
    quantile(values, 0.5)
}

/// Standard deviation of normal errors over the median of their absolute values.
const DEVIATION_OF_MEDIAN: f64 = 1.4826;
/// Scale of Cauchy's weights that has an efficiency of 95 % with normal errors (Holland and Welsch, 1977).
const CAUCHY: f64 = 2.385;
/// Tukey's constant: the standard deviations from which an error has no weight, for an efficiency of 95 % with normal
/// errors (Holland and Welsch, 1977).
pub const TUKEY: f64 = 4.685;

/// Returns the standard deviation of normal errors with these absolute values, by their median; `None` without values.
pub fn robust_deviation(sizes: &[f64]) -> Option<f64> {
    median(sizes).map(|size| DEVIATION_OF_MEDIAN * size)
}

/// Returns the weight of an error by Cauchy's loss, in (0, 1], for errors of a positive standard deviation.
pub fn cauchy_weight(error: f64, deviation: f64) -> f64 {
    1.0 / (1.0 + (error / (CAUCHY * deviation)).powi(2))
}

/// Returns Tukey's weight of an error, in [0, 1], for a standard deviation of errors.
pub fn tukey_weight(error: f64, deviation: f64) -> f64 {
    let share = error / (TUKEY * deviation).max(f64::MIN_POSITIVE);
    let inside = 1.0 - share * share;
    if inside > 0.0 { inside * inside } else { 0.0 }
}

/// Returns the larger of two values; NaN if either is NaN, so that a maximum of errors does not hide one.
pub fn largest_or_nan(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        return f64::NAN;
    }
    a.max(b)
}

/// Returns the quantile `share` in [0, 1] of the values whose times are within `reach_seconds` of that of `index`.
/// `times` is sorted and as long as `values`.
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

/// Largest deviation of a frame's interval from the median, as a share of the median. At 120 frames per second whole
/// milliseconds are 8 and 9, and a dropped frame makes twice the median.
const FRAME_INTERVAL_SPREAD: f64 = 0.25;

/// Returns the typical distance of consecutive timestamps in the unit of the times; `None` for fewer than two.
///
/// It is the mean of the distances within a quarter of their median: gaps and dropped frames do not count. The
/// rounding of time stamps averages out, which the median alone would keep (41 and 42 ms at 24 frames per second).
pub fn frame_interval(times: &[f64]) -> Option<f64> {
    let intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let median = median(&intervals)?;
    let of_frames = intervals
        .iter()
        .filter(|&interval| (interval - median).abs() <= FRAME_INTERVAL_SPREAD * median);
    let count = of_frames.clone().count();
    // Times that go backwards may leave none.
    Some(match count {
        0 => median,
        count => of_frames.sum::<f64>() / count as f64,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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
    fn one_foreign_error_in_three_does_not_change_the_deviation() {
        assert_eq!(robust_deviation(&[]), None);
        let found = robust_deviation(&[2.0, 1e9, 1.0]).unwrap_or_default();
        assert!((found - 2.0 * 1.4826).abs() < 1e-12, "{found}");
    }

    #[test]
    fn cauchys_weight_is_half_at_its_constant() {
        for (share, expected) in [(0.0, 1.0), (1.0, 0.5), (-1.0, 0.5), (3.0, 0.1)] {
            let found = cauchy_weight(share * 2.385 * 0.2, 0.2);
            assert!((found - expected).abs() < 1e-12, "{share}: {found}");
        }
    }

    #[test]
    fn tukeys_weights_fall_to_nothing_at_the_constant() {
        for (share, expected) in [
            (0.0, 1.0),
            (0.5, 0.5625),
            (-0.5, 0.5625),
            (1.0, 0.0),
            (3.0, 0.0),
        ] {
            let found = tukey_weight(share * TUKEY * 0.2, 0.2);
            assert!((found - expected).abs() < 1e-12, "{share}: {found}");
        }
    }

    #[test]
    fn no_maximum_hides_nan() {
        assert_eq!([1.0, 3.0, 2.0].into_iter().fold(0.0, largest_or_nan), 3.0);
        for values in [[f64::NAN, 1.0], [1.0, f64::NAN]] {
            assert!(values.into_iter().fold(0.0, largest_or_nan).is_nan());
        }
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
        assert_eq!(frame_interval(&[2.0, 2.0, 2.0]), Some(0.0));
        assert_eq!(frame_interval(&[3.0, 2.0, 1.0]), Some(-1.0));
    }

    /// Rates of video in frames per second.
    const RATES: [f64; 4] = [
        24.0,
        24_000.0 / 1001.0,
        30_000.0 / 1001.0,
        60_000.0 / 1001.0,
    ];

    proptest! {
        /// Clocks of Matroska (1 ms) and MPEG-TS (1/90000 s), a tenth of the frames dropped, and a long gap.
        #[test]
        fn rounded_times_with_drops_and_a_gap_keep_the_rate(
            lots in prop::collection::vec(0_u8..10, 1500),
            begin in 0.0_f64..100.0,
            gap in 1.0_f64..5000.0,
            gap_at in 100_usize..1400,
        ) {
            for rate in RATES {
                for ticks_per_second in [1e3, 9e4] {
                    for (drops, gap) in [(false, 0.0), (true, 0.0), (false, gap), (true, gap)] {
                        let times: Vec<f64> = (0..lots.len())
                            .filter(|&frame| !drops || lots[frame] > 0)
                            .map(|frame| {
                                let shift = if frame < gap_at { 0.0 } else { gap };
                                let time = begin + shift + frame as f64 / rate;
                                (time * ticks_per_second).round() / ticks_per_second
                            })
                            .collect();
                        let found = frame_interval(&times).unwrap_or_default();
                        prop_assert!(
                            (found * rate - 1.0).abs() < 2e-3,
                            "{rate} fps at {ticks_per_second} ticks, drops {drops}, gap {gap}: {found}"
                        );
                    }
                }
            }
        }
    }
}
