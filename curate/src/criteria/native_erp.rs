//! Is it native ERP?

use omnilife_schemas::records::{ErpVerdict, Verdict};

use super::{Check, outcome};

/// The video is monoscopic ERP, stored at 2:1.
pub(super) const CHECK: Check = Check {
    id: "native-erp",
    summary: "The video is monoscopic ERP, stored at 2:1.",
    evaluate: |thresholds, candidate| {
        let ErpVerdict {
            verdict,
            overridden,
            ..
        } = candidate.verdict?;
        let value = match overridden {
            Some(found) => format!("{}, accepted as {}", found.name(), verdict.name()),
            None => verdict.name().to_owned(),
        };
        thresholds.native_erp.then(|| {
            outcome(
                &CHECK,
                *verdict == Verdict::Erp,
                value,
                Verdict::Erp.name().to_owned(),
            )
        })
    },
};
