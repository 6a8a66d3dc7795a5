//! Check for prominent artificial overlays.

use omnilife_schemas::records::{Overlay, OverlayClass, OverlayReport, OverlaySpan, TimeRange};

use super::{Check, Thresholds, outcome};

/// No watermark, caption or mosaic of some size.
pub(super) const CHECK: Check = Check {
    id: "overlays",
    summary: "Nothing artificial of a prominent size is painted over the image, and no mosaic of \
              that size moves through it for long. A patch over the tripod and the rig itself hide \
              nothing that could be reconstructed.",
    evaluate: |thresholds, candidate| {
        let most = thresholds.largest_overlay_steradians?;
        let (passed, value) = judged(candidate.overlays?, thresholds, most);
        let lasting = thresholds
            .largest_mosaic_share
            .map_or_else(String::new, |share| {
                format!(", or a moving mosaic in at most {share} of the frames")
            });
        Some(outcome(
            &CHECK,
            passed,
            value,
            format!("at most {most} sr{lasting}"),
        ))
    },
};

/// Returns the outcome and the overlays that were found.
fn judged(report: &OverlayReport, thresholds: &Thresholds, most_steradians: f64) -> (bool, String) {
    let largest = report
        .overlays
        .iter()
        .filter(|overlay| spoils(overlay, thresholds))
        .max_by(|a, b| {
            a.solid_angle_steradians
                .total_cmp(&b.solid_angle_steradians)
        });
    let value = match (largest, &report.unjudged) {
        (Some(overlay), _) => described(overlay, report),
        (None, Some(reason)) => format!("not judged: {reason}"),
        (None, None) => format!("none{}", unjudged_shots(report)),
    };
    let passed = largest.is_none_or(|overlay| overlay.solid_angle_steradians <= most_steradians);
    (passed, value)
}

/// Returns true if an overlay hides reconstructible content; a moving mosaic, if it does so for long enough.
fn spoils(overlay: &Overlay, thresholds: &Thresholds) -> bool {
    let most_share = thresholds.largest_mosaic_share.unwrap_or(0.0);
    let is_brief_mosaic = overlay.class == OverlayClass::Mosaic
        && (overlay.sightings.as_ref()).is_some_and(|sightings| sightings.share() <= most_share);
    overlay.class.spoils_geometry() && !is_brief_mosaic
}

/// Returns the number of shots in which too little moved for a judgement, in words; empty if all were judged.
fn unjudged_shots(report: &OverlayReport) -> String {
    let shots = |is_judged: bool| -> u32 {
        let spans = report.spans.iter();
        (spans.filter(|span| span.is_judged || !is_judged))
            .map(|span| span.shots)
            .sum()
    };
    let (all, judged) = (shots(false), shots(true));
    match all - judged {
        0 => String::new(),
        unjudged => format!("; {unjudged} of {all} shots too short or too static to be judged"),
    }
}

fn described(overlay: &Overlay, report: &OverlayReport) -> String {
    let seen = overlay
        .sightings
        .as_ref()
        .map_or_else(String::new, |sightings| {
            format!(
                ", seen in {} of {} frames",
                sightings.seen_frames, sightings.looked_at_frames
            )
        });
    let times = match overlay.ranges.as_slice() {
        [] => String::new(),
        [first, ..] => {
            let seconds: f64 = (overlay.ranges.iter())
                .map(TimeRange::duration_seconds)
                .sum();
            format!(", for {seconds:.1} s from {:.1} s on", first.begin_seconds)
        }
    };
    let shots = match report.spans.len() {
        0 | 1 => String::new(),
        _ => in_shots(overlay, report),
    };
    format!(
        "{} of {:.4} sr at longitude {:.0}, latitude {:.0} degrees{times}{shots}{seen}",
        overlay.class.name(),
        overlay.solid_angle_steradians,
        overlay.longitude_degrees,
        overlay.latitude_degrees
    )
}

/// Returns the numbers of the shots in which an overlay stays, from 0; empty for one that is seen in single frames.
fn in_shots(overlay: &Overlay, report: &OverlayReport) -> String {
    let name = |span: &OverlaySpan| match span.shots {
        1 => span.first_shot.to_string(),
        shots => format!("{}-{}", span.first_shot, span.first_shot + shots - 1),
    };
    let names: Vec<String> = report.spans_of(overlay).map(name).collect();
    match names.is_empty() {
        true => String::new(),
        false => format!(" (shots {})", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::Sightings;

    use omnilife_schemas::records::Probe;

    use super::*;
    use crate::criteria::{Candidate, Criteria, OMNILIFE360, admit, failures, unenforced};

    fn moving_mosaic(steradians: f64, seen_frames: u32) -> Overlay {
        Overlay {
            class: OverlayClass::Mosaic,
            longitude_degrees: 30.0,
            latitude_degrees: 0.0,
            solid_angle_steradians: steradians,
            extent_degrees: None,
            constancy: 0.0,
            stayed: 0.0,
            strength_levels: 20.0,
            variation_levels: 5.0,
            saturated_share: 0.0,
            sightings: Some(Sightings {
                seen_frames,
                looked_at_frames: 100,
                reach_degrees: 10.0,
                block_pixels: 16.0,
            }),
            ranges: Vec::new(),
        }
    }

    /// Size and time both count, and a video whose scene does not move is judged by its mosaics too.
    #[test]
    fn a_moving_mosaic_is_rejected_when_it_is_large_and_lasts() {
        for (steradians, seen_frames, passes) in [
            (0.03, 4, true),
            (0.03, 6, false),
            (0.01, 90, true),
            (0.03, 90, false),
        ] {
            let report = OverlayReport {
                unjudged: Some("nothing moved".to_owned()),
                moving_steps: 0,
                overlays: vec![moving_mosaic(steradians, seen_frames)],
                spans: Vec::new(),
            };
            let (passed, value) = judged(&report, &OMNILIFE360.thresholds, 0.02);
            assert_eq!(passed, passes, "{steradians} sr, {seen_frames} frames");
            let told = format!("seen in {seen_frames} of 100 frames");
            assert_eq!(value.ends_with(&told), seen_frames > 5, "{value}");
        }
        // Without a named share no mosaic is allowed.
        let anywhere = Thresholds::default();
        assert!(spoils(&moving_mosaic(0.03, 3), &anywhere));
        let caption = Overlay {
            class: OverlayClass::Caption,
            ..moving_mosaic(0.03, 3)
        };
        assert!(spoils(&caption, &OMNILIFE360.thresholds));
    }

    /// The published criteria report a mosaic of 0.03 sr and admit its video; criteria of a file reject it.
    #[test]
    fn overlays_reject_by_criteria_of_a_file_alone() {
        let report = OverlayReport {
            unjudged: None,
            moving_steps: 20,
            overlays: vec![moving_mosaic(0.03, 90)],
            spans: Vec::new(),
        };
        let probe = Probe::of_size([4096, 2048]);
        let candidate = Candidate {
            probe: &probe,
            layout: None,
            projection: None,
            damaged_frames: None,
            overlays: Some(&report),
        };
        let overlays_alone = |overlays_are_reported_only| Criteria {
            name: "overlays".to_owned(),
            thresholds: Thresholds {
                largest_overlay_steradians: Some(0.02),
                overlays_are_reported_only,
                ..Thresholds::default()
            },
        };
        const { assert!(OMNILIFE360.thresholds.overlays_are_reported_only) };
        let admission = admit(&overlays_alone(true), &candidate, true);
        assert!(admission.admitted && failures(&admission).is_none());
        assert_eq!((admission.checks.len(), admission.reported.len()), (0, 1));
        let lines = unenforced(&admission);
        assert_eq!(lines.len(), 1);
        assert!(
            lines[0].contains("0.03") && lines[0].contains("--criteria"),
            "{lines:?}"
        );
        let admission = admit(&overlays_alone(false), &candidate, true);
        assert!(!admission.admitted && failures(&admission).is_some());
        assert!(unenforced(&admission).is_empty());
    }

    fn span(first_shot: u32, is_judged: bool) -> OverlaySpan {
        let begin = 10.0 * f64::from(first_shot);
        OverlaySpan {
            range: TimeRange::new(begin, begin + 9.0),
            first_shot,
            shots: 1,
            moving_steps: if is_judged { 20 } else { 3 },
            is_judged,
        }
    }

    #[test]
    fn shots_of_a_find_and_those_not_judged_are_named() {
        let watermark = Overlay {
            class: OverlayClass::Watermark,
            sightings: None,
            ranges: vec![TimeRange::new(10.0, 19.0)],
            ..moving_mosaic(0.05, 0)
        };
        let mut report = OverlayReport {
            unjudged: None,
            moving_steps: 23,
            overlays: vec![watermark],
            spans: vec![span(0, false), span(1, true), span(2, true)],
        };
        let (passed, value) = judged(&report, &OMNILIFE360.thresholds, 0.02);
        assert!(!passed);
        assert!(value.contains("(shots 1)"), "{value}");
        report.overlays.clear();
        let (passed, value) = judged(&report, &OMNILIFE360.thresholds, 0.02);
        assert!(passed);
        assert!(value.contains("1 of 3 shots"), "{value}");
    }
}
