//! Real footage beside the checkout; skipped with a reason where it is not there.

use omnilife_curate::{analysis::Analysis, boundaries::DETECTORS, projection};
use omnilife_schemas::records::{Boundary, BoundaryKind, VideoProjection};

use crate::footage::{of_real_clip, support};

/// A clip with the projection it must get and the frames at which its shots begin; a transition is
/// given by its first and last frame.
struct Expectation {
    file: &'static str,
    projection: VideoProjection,
    boundaries: &'static [(usize, usize)],
}

const CLIPS: &[Expectation] = &[
    Expectation {
        file: "tunnel.mp4",
        projection: VideoProjection::ErpSqueezed,
        boundaries: &[],
    },
    Expectation {
        file: "reef.mp4",
        projection: VideoProjection::ErpSqueezed,
        boundaries: &[(714, 718), (890, 890), (1059, 1059)],
    },
    Expectation {
        file: "city4k.mp4",
        projection: VideoProjection::Erp,
        boundaries: &[],
    },
    Expectation {
        file: "congo_stereo.mp4",
        projection: VideoProjection::ErpStereoTb,
        boundaries: &[],
    },
    Expectation {
        file: "bikes.mp4",
        projection: VideoProjection::Rectilinear,
        boundaries: &[(30, 30), (76, 76), (137, 137), (187, 187), (242, 242)],
    },
];

/// Frames from the first that is not of the old shot alone to the first of the new shot alone.
fn frames(analysis: &Analysis, boundary: &Boundary) -> (usize, usize) {
    let index = |seconds: f64| {
        analysis
            .signals
            .times
            .iter()
            .position(|&time| time >= seconds - 1e-6)
            .unwrap()
    };
    (
        index(boundary.begin_seconds) + 1,
        index(boundary.end_seconds),
    )
}

#[test]
fn projections_and_boundaries() {
    for expected in CLIPS {
        of_real_clip(expected.file, |analysis| {
            assert_as_expected(expected, analysis);
        });
    }
}

fn assert_as_expected(expected: &Expectation, analysis: &Analysis) {
    let projection = projection::judge(&analysis.probe, analysis.samples.images());
    println!("{}: {}", expected.file, projection.projection.name());
    for evidence in &projection.evidence {
        println!(
            "  {:20} {:.3} (limit {})",
            evidence.test, evidence.value, evidence.limit
        );
    }
    assert_eq!(
        projection.projection, expected.projection,
        "{}",
        expected.file
    );
    assert_eq!(projection.disagreement, None, "{}", expected.file);

    let found = (DETECTORS[0].decide)(&analysis.signals).unwrap();
    let spans: Vec<_> = found
        .iter()
        .map(|boundary| frames(analysis, boundary))
        .collect();
    println!("  boundaries {spans:?}");
    assert_eq!(
        spans.len(),
        expected.boundaries.len(),
        "{}: {spans:?}",
        expected.file
    );
    for ((first, last), boundary) in spans.iter().zip(&found) {
        let hit = expected
            .boundaries
            .iter()
            .find(|(begin, end)| first <= begin && end <= last)
            .unwrap();
        // No more than a few frames of fast motion around a transition go with it.
        assert!(
            begin_slack(*first, hit.0) && begin_slack(hit.1, *last),
            "{spans:?}"
        );
        let is_cut = hit.0 == hit.1;
        assert_eq!(boundary.kind == BoundaryKind::Cut, is_cut);
    }
}

fn begin_slack(early: usize, late: usize) -> bool {
    late - early <= 6
}

#[test]
fn metadata_of_real_files() {
    let Some(path) = support::shared_data("congo_stereo.mp4") else {
        return;
    };
    let probe = omnilife_video::probe(&path).unwrap();
    let spherical = probe.spherical.unwrap();
    assert_eq!(spherical.projection, "equirectangular");
    assert_eq!(spherical.stereo.as_deref(), Some("top and bottom"));
    assert_eq!((probe.width, probe.height), (1920, 1080));
    assert_eq!(probe.pixel_aspect_ratio, 0.5625);
    assert_eq!(probe.bit_depth, 8);
    assert_eq!(probe.pixel_format, "yuv420p");
}
