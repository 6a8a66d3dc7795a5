//! Resolution check.

use super::{Check, outcome};

/// The image is wide enough.
pub(super) const CHECK: Check = Check {
    id: "resolution",
    summary: "The image is wide enough.",
    evaluate: |thresholds, candidate| {
        let least = thresholds.least_width_pixels?;
        let (width, height) = candidate.probe.upright_size();
        Some(outcome(
            &CHECK,
            width >= least,
            format!("{width}x{height} pixels"),
            format!("a width of at least {least} pixels"),
        ))
    },
};
