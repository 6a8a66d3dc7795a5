//! Frame rate check.

use super::{Check, outcome};

/// The mean frame rate is high enough.
pub(super) const CHECK: Check = Check {
    id: "frame-rate",
    summary: "The mean frame rate is high enough.",
    evaluate: |thresholds, candidate| {
        let least = thresholds.least_frames_per_second?;
        let rate = candidate.probe.frames_per_second;
        // A header is wrong by a frame, or by more: time stamps decide.
        if candidate.probe.variable_frame_rate.is_none() && candidate.projection.is_none() {
            return None;
        }
        let value = match (
            candidate.probe.variable_frame_rate,
            candidate.probe.longest_interval_seconds,
        ) {
            (Some(true), Some(longest)) => {
                format!("{rate:.3} fps on average, variable, with gaps of up to {longest:.3} s")
            }
            _ => format!("{rate:.3} fps"),
        };
        Some(outcome(
            &CHECK,
            rate >= least,
            value,
            format!("at least {least:.3} fps"),
        ))
    },
};
