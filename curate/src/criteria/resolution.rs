//! Is it large enough?

use super::{Check, outcome};

/// The picture is wide enough.
pub(super) const CHECK: Check = Check {
    id: "resolution",
    summary: "The picture is wide enough.",
    evaluate: |thresholds, candidate| {
        let least = thresholds.least_width_pixels?;
        let width = candidate.probe.width;
        Some(outcome(
            &CHECK,
            width >= least,
            format!("{width}x{} pixels", candidate.probe.height),
            format!("a width of at least {least} pixels"),
        ))
    },
};
