//! Is it free of prominent artificial overlays?

use super::{Check, outcome};

/// No watermark, caption or mosaic of some size.
pub(super) const CHECK: Check = Check {
    id: "overlays",
    summary: "Nothing artificial of a prominent size is painted over the picture. A patch over the \
              tripod and the rig itself hide nothing that could be reconstructed.",
    evaluate: |thresholds, candidate| {
        let most = thresholds.largest_overlay_steradians?;
        let report = candidate.overlays?;
        let largest = report
            .overlays
            .iter()
            .filter(|overlay| overlay.class.spoils_geometry())
            .max_by(|a, b| {
                a.solid_angle_steradians
                    .total_cmp(&b.solid_angle_steradians)
            });
        let value = match (largest, &report.unjudged) {
            (_, Some(reason)) => format!("not judged: {reason}"),
            (None, None) => "none".to_owned(),
            (Some(overlay), None) => format!(
                "{} of {:.4} sr at longitude {:.0}, latitude {:.0} degrees",
                overlay.class.name(),
                overlay.solid_angle_steradians,
                overlay.longitude_degrees,
                overlay.latitude_degrees
            ),
        };
        Some(outcome(
            &CHECK,
            largest.is_none_or(|overlay| overlay.solid_angle_steradians <= most),
            value,
            format!("at most {most} sr"),
        ))
    },
};
