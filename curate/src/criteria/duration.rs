//! Duration check.

use super::{Check, outcome};

/// The video is long enough.
pub(super) const CHECK: Check = Check {
    id: "duration",
    summary: "The video is long enough.",
    evaluate: |thresholds, candidate| {
        let limit = thresholds.longer_than_seconds?;
        let duration = candidate.probe.duration_seconds;
        // A header may leave it open; the analysis measures it.
        if duration <= 0.0 && candidate.projection.is_none() {
            return None;
        }
        Some(outcome(
            &CHECK,
            duration > limit,
            format!("{duration:.2} s"),
            format!("more than {limit} s"),
        ))
    },
};
