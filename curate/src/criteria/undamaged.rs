//! Damage check.

use super::{Check, outcome};

/// Every frame decodes without damage.
pub(super) const CHECK: Check = Check {
    id: "undamaged",
    summary: "Every frame decodes without damage.",
    evaluate: |thresholds, candidate| {
        let damaged = candidate.damaged_frames?;
        thresholds.undamaged.then(|| {
            outcome(
                &CHECK,
                damaged == 0,
                format!("{damaged} damaged frames"),
                "0 damaged frames".to_owned(),
            )
        })
    },
};
