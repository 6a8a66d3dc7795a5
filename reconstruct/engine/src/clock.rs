//! Time in frames, the unit of all temporal parameters.
//!
//! Times of views are seconds in f64, and so is their difference from the clip's middle, in frames.
//! Parameters are f32: exact to a thousandth of a frame in clips of ten thousand frames, wherever on its
//! source's time line the clip begins. Only the final difference of view time and parameter is rounded to
//! f32. Rounding the view time first would displace a lifespan of a quarter of a frame.

use omnilife_schemas::statistics;
use serde::{Deserialize, Serialize};

/// Conversion from seconds to frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// The middle of the clip, seconds.
    pub origin_seconds: f64,
    /// Median time from one frame to the next, seconds.
    pub frame_seconds: f64,
    /// Time from the first frame to the last, frames.
    pub duration_frames: f32,
}

/// Time span.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeSpan {
    /// First moment, seconds.
    pub begin_seconds: f64,
    /// Last moment, seconds.
    pub end_seconds: f64,
    /// Number of frames, if the span is that of a clip.
    pub frames: Option<usize>,
}

impl TimeSpan {
    /// Returns the smallest span that contains both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            begin_seconds: self.begin_seconds.min(other.begin_seconds),
            end_seconds: self.end_seconds.max(other.end_seconds),
            frames: self.frames.max(other.frames),
        }
    }

    /// Returns the moment half-way, seconds.
    pub fn middle_seconds(&self) -> f64 {
        0.5 * (self.begin_seconds + self.end_seconds)
    }

    /// Returns `count` evenly spaced moments from the first to the last, seconds; the middle if `count` is 1.
    pub fn moments(&self, count: usize) -> Vec<f64> {
        if count < 2 {
            return vec![self.middle_seconds()];
        }
        let length = self.end_seconds - self.begin_seconds;
        (0..count)
            .map(|index| self.begin_seconds + length * index as f64 / (count - 1) as f64)
            .collect()
    }
}

impl Clock {
    /// Makes a clock from the middle of the clip and the time between frames, seconds, and the clip's length, frames.
    pub const fn new(origin_seconds: f64, frame_seconds: f64, duration_frames: f32) -> Self {
        Self {
            origin_seconds,
            frame_seconds,
            duration_frames,
        }
    }

    /// Creates the clock of increasing times in seconds. A single frame lasts one second.
    pub fn from_times(times: &[f64]) -> Self {
        let (first, last) = match (times.first(), times.last()) {
            (Some(&first), Some(&last)) => (first, last),
            _ => (0.0, 0.0),
        };
        let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let frame_seconds = statistics::median(&steps).unwrap_or(1.0);
        Self {
            origin_seconds: first + 0.5 * (last - first),
            frame_seconds,
            duration_frames: ((last - first) / frame_seconds) as f32,
        }
    }

    /// Returns the span from the clip's first frame to its last.
    pub fn span(&self) -> TimeSpan {
        let half = 0.5 * f64::from(self.duration_frames) * self.frame_seconds;
        TimeSpan {
            begin_seconds: self.origin_seconds - half,
            end_seconds: self.origin_seconds + half,
            frames: Some(self.duration_frames.round() as usize + 1),
        }
    }

    /// Returns a time in frames from the clip's middle.
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
    fn moments_are_evenly_apart_from_the_first_frame_to_the_last() {
        let span = Clock::from_times(&[3.0, 3.5, 4.0, 4.5]).span();
        assert_eq!(
            (span.begin_seconds, span.end_seconds, span.frames),
            (3.0, 4.5, Some(4))
        );
        assert_eq!(span.moments(4), [3.0, 3.5, 4.0, 4.5]);
        assert_eq!(span.moments(1), [3.75]);
        let later = Clock::from_times(&[4.0, 6.0]).span();
        let both = span.union(later);
        assert_eq!((both.begin_seconds, both.end_seconds), (3.0, 6.0));
    }

    #[test]
    fn one_frame_and_two_have_a_clock() {
        let one = Clock::from_times(&[3.0]);
        assert_eq!((one.frame(3.0), one.duration_frames), (0.0, 0.0));
        let two = Clock::from_times(&[3.0, 3.5]);
        assert_eq!((two.frame(3.0), two.frame(3.5)), (-0.5, 0.5));
    }
}
