//! Is it native ERP?

use omnilife_schemas::records::Verdict;

use super::{Check, outcome};

/// The video is monoscopic ERP, stored at 2:1.
pub(super) const CHECK: Check = Check {
    id: "native-erp",
    summary: "The video is monoscopic ERP, stored at 2:1.",
    evaluate: |thresholds, candidate| {
        let verdict = candidate.verdict?;
        thresholds.native_erp.then(|| {
            outcome(
                &CHECK,
                verdict == Verdict::Erp,
                verdict.name().to_owned(),
                Verdict::Erp.name().to_owned(),
            )
        })
    },
};
