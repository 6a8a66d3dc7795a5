//! Is its frame rate high enough?

use super::{Check, outcome};

/// The mean frame rate is high enough.
pub(super) const CHECK: Check = Check {
    id: "frame-rate",
    summary: "The mean frame rate is high enough.",
    evaluate: |thresholds, candidate| {
        let least = thresholds.least_frames_per_second?;
        let rate = candidate.probe.frames_per_second;
        Some(outcome(
            &CHECK,
            rate >= least,
            format!("{rate:.3} fps"),
            format!("at least {least:.3} fps"),
        ))
    },
};
