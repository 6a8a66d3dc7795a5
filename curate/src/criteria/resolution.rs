//! Resolution check.

use super::{Check, outcome};

/// The panorama is wide enough, however the video stores it.
pub(super) const CHECK: Check = Check {
    id: "resolution",
    summary: "The image is wide enough.",
    evaluate: |thresholds, candidate| {
        let least = thresholds.least_width_pixels?;
        let (width, height) = candidate.probe.sphere_size(candidate.layout);
        let (stored_width, stored_height) = candidate.probe.upright_size();
        let size = match candidate.layout {
            Some(layout) => {
                format!("{width}x{height} pixels, {layout} in {stored_width}x{stored_height}")
            }
            None => format!("{width}x{height} pixels"),
        };
        Some(outcome(
            &CHECK,
            width >= least,
            size,
            format!("a width of at least {least} pixels"),
        ))
    },
};
