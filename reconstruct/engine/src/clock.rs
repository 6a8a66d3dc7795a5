//! Time in frames: what temporal parameters are measured in.
//!
//! Times of views are seconds in f64, and so is their difference from the clip's middle, in frames.
//! Parameters are f32: exact to a thousandth of a frame in clips of ten thousand frames, wherever on
//! its source's time line the clip begins. Only the difference of the two is rounded again: a moment
//! that is rounded first puts a life of a quarter of a frame elsewhere.

use serde::{Deserialize, Serialize};

/// From seconds to frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// The middle of the clip, seconds.
    pub origin_seconds: f64,
    /// Median time from one frame to the next, seconds.
    pub frame_seconds: f64,
    /// Time from the first frame to the last, frames.
    pub duration_frames: f32,
}

impl Clock {
    /// The clock of increasing times in seconds. One frame alone lasts a second.
    pub fn from_times(times: &[f64]) -> Self {
        let (first, last) = match (times.first(), times.last()) {
            (Some(&first), Some(&last)) => (first, last),
            _ => (0.0, 0.0),
        };
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        let frame_seconds = steps.get(steps.len() / 2).copied().unwrap_or(1.0);
        Self {
            origin_seconds: first + 0.5 * (last - first),
            frame_seconds,
            duration_frames: ((last - first) / frame_seconds) as f32,
        }
    }

    /// A time in frames from the clip's middle.
    pub fn frame(&self, seconds: f64) -> f64 {
        (seconds - self.origin_seconds) / self.frame_seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_count_from_the_middle_wherever_the_clip_begins() {
        for begin in [0.0, -7.0, 1e6] {
            let times: Vec<f64> = (0..10_001).map(|i| begin + f64::from(i) / 30.0).collect();
            let clock = Clock::from_times(&times);
            assert!((clock.duration_frames - 10_000.0).abs() < 0.01, "{clock:?}");
            for (index, expected) in [(0, -5_000.0), (5_000, 0.0), (5_003, 3.0), (10_000, 5_000.0)]
            {
                let frame = clock.frame(times[index]);
                assert!((frame - expected).abs() < 1e-5, "{frame} {expected}");
            }
        }
    }

    #[test]
    fn a_gap_does_not_change_the_length_of_a_frame() {
        let clock = Clock::from_times(&[0.0, 0.1, 0.2, 0.3, 5.0, 5.1]);
        assert!((clock.frame_seconds - 0.1).abs() < 1e-12);
    }

    #[test]
    fn one_frame_and_two_have_a_clock() {
        let one = Clock::from_times(&[3.0]);
        assert_eq!((one.frame(3.0), one.duration_frames), (0.0, 0.0));
        let two = Clock::from_times(&[3.0, 3.5]);
        assert_eq!((two.frame(3.0), two.frame(3.5)), (-0.5, 0.5));
    }
}
