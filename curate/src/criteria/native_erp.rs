//! Native ERP check.

use omnilife_schemas::records::{DetectedProjection, VideoProjection};

use super::{Check, outcome};

/// The video is monoscopic ERP, stored at 2:1.
pub(super) const CHECK: Check = Check {
    id: "native-erp",
    summary: "The video is monoscopic ERP, stored at 2:1.",
    evaluate: |thresholds, candidate| {
        let DetectedProjection {
            projection,
            overridden,
            ..
        } = candidate.projection?;
        let value = match overridden {
            Some(found) => format!("{}, accepted as {}", found.name(), projection.name()),
            None => projection.name().to_owned(),
        };
        thresholds.native_erp.then(|| {
            outcome(
                &CHECK,
                *projection == VideoProjection::Erp,
                value,
                VideoProjection::Erp.name().to_owned(),
            )
        })
    },
};
