//! Instants at which motion is measured in a video: pairs of frames that are close in time, spread over a shot.

use omnilife_schemas::records::TimeRange;

/// Pairs that are compared at most, spread over a sequence.
pub const MOST_PAIRS: usize = 24;
/// Distance of the frames of a pair, seconds: a walk shows, and fast turns are still found.
const SPACING_SECONDS: f64 = 0.15;
/// Sampled frames this close are compared themselves, seconds.
const NEAR_SECONDS: f64 = 0.25;
/// Frames farther apart than this do not show how the camera moves, seconds.
pub const LARGEST_GAP_SECONDS: f64 = 0.5;

/// Returns pairs of instants, in order and without overlap, of frames of a shot that are about 0.15 s apart.
///
/// `times` are the timestamps of all frames of the video in order, `sampled` those of the sampled ones. The result is
/// empty where most of the sampled frames are that close themselves, or where no frames of the shot are within
/// [`LARGEST_GAP_SECONDS`] of each other.
pub fn choose_pairs(times: &[f64], shot: TimeRange, sampled: &[f64]) -> Vec<[f64; 2]> {
    let is_near = |pair: &&[f64]| pair[1] - pair[0] <= NEAR_SECONDS;
    let near = sampled.windows(2).filter(is_near).count();
    if near > 0 && 2 * near >= sampled.len() - 1 {
        return Vec::new();
    }
    let first = times.partition_point(|&time| time < shot.begin_seconds);
    let last = times.partition_point(|&time| time < shot.end_seconds);
    let inside = &times[first..last];
    let [begin, .., end] = inside else {
        return Vec::new();
    };
    let mut pairs: Vec<[f64; 2]> = Vec::new();
    for number in 0..MOST_PAIRS {
        let share = (number as f64 + 0.5) / MOST_PAIRS as f64;
        let instant = begin + share * (end - begin - SPACING_SECONDS).max(0.0);
        let from = nearest(inside, instant).min(inside.len() - 2);
        let to = nearest(inside, inside[from] + SPACING_SECONDS).max(from + 1);
        let pair = [inside[from], inside[to]];
        let is_behind = pairs.last().is_none_or(|last| last[1] < pair[0]);
        if is_behind && pair[1] - pair[0] <= LARGEST_GAP_SECONDS {
            pairs.push(pair);
        }
    }
    pairs
}

/// Returns the number of the value of sorted, non-empty `times` that is nearest to an instant.
fn nearest(times: &[f64], instant: f64) -> usize {
    let after = times.partition_point(|&time| time < instant);
    match after {
        0 => 0,
        after if after == times.len() => after - 1,
        after if instant - times[after - 1] <= times[after] - instant => after - 1,
        after => after,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steady(seconds: f64, rate: f64) -> (Vec<f64>, TimeRange) {
        let count = (seconds * rate).round() as usize;
        let times = (0..count).map(|index| index as f64 / rate).collect();
        let range = TimeRange::new(0.0, seconds);
        (times, range)
    }

    #[test]
    fn a_long_sequence_is_measured_at_instants_all_over_it() {
        let (times, shot) = steady(98.0, 30.0);
        // Every 25th frame: 118 samples, 0.83 s apart.
        let sampled: Vec<f64> = times.iter().copied().step_by(25).collect();
        let pairs = choose_pairs(&times, shot, &sampled);
        assert_eq!(pairs.len(), MOST_PAIRS);
        for pair in &pairs {
            let gap = pair[1] - pair[0];
            assert!((0.1..=0.2).contains(&gap), "{gap} s");
            assert!(pair.iter().all(|time| times.contains(time)));
        }
        assert!(pairs[0][0] < 3.0 && pairs[MOST_PAIRS - 1][1] > 95.0);
        assert!(pairs.windows(2).all(|two| two[0][1] < two[1][0]));
    }

    #[test]
    fn no_pairs_are_taken_where_samples_are_close_or_nothing_is() {
        let (times, shot) = steady(4.0, 10.0);
        assert_eq!(choose_pairs(&times, shot, &times), [[0.0; 2]; 0]);
        let (slow, shot) = steady(98.0, 1.0);
        assert_eq!(choose_pairs(&slow, shot, &slow), [[0.0; 2]; 0]);
        for times in [&[][..], &[1.0]] {
            assert_eq!(choose_pairs(times, shot, times), [[0.0; 2]; 0]);
        }
    }

    #[test]
    fn a_short_shot_gives_the_pairs_that_it_has() {
        let (times, shot) = steady(1.0, 5.0);
        let pairs = choose_pairs(&times, shot, &times[..1]);
        assert!(!pairs.is_empty() && pairs.len() < times.len(), "{pairs:?}");
        assert!(pairs.windows(2).all(|two| two[0][1] < two[1][0]));
    }
}
