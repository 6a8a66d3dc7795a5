//! Painted overlays on footage are found, and its own content is not mistaken for one. Versions come from
//! `scripts/fixtures/overlays`.

use std::{path::Path, process::Command};

use omnilife_curate::{
    analysis::{Analysis, analyse},
    boundaries::DETECTORS,
    overlays::report,
};
use omnilife_schemas::{
    progress::Silent,
    records::{Overlay, OverlayClass, OverlayReport},
    store::paths_in,
};

use crate::footage::{of_real_clip, support};

fn reported(analysis: &Analysis) -> OverlayReport {
    let boundaries = (DETECTORS[0].decide)(&analysis.signals).unwrap();
    report(&analysis.overlays, &analysis.mosaics, &boundaries)
}

/// Largest artificial overlay, if there is a prominent one.
fn prominent(report: &OverlayReport) -> Option<OverlayClass> {
    report
        .overlays
        .iter()
        .filter(|overlay| overlay.class != OverlayClass::Rig)
        .find(|overlay| overlay.solid_angle_steradians > 0.02)
        .map(|overlay| overlay.class)
}

/// Returns whether there is a prominent mosaic, besides other overlays, in words.
fn largest_mosaic(report: &OverlayReport) -> &'static str {
    let is_large_mosaic = |overlay: &Overlay| {
        overlay.class == OverlayClass::Mosaic && overlay.solid_angle_steradians > 0.02
    };
    if report.overlays.iter().any(is_large_mosaic) {
        "mosaic"
    } else {
        "no-mosaic"
    }
}

/// Painted versions of moving footage: the class found is the painted one.
#[test]
fn painted_overlays_are_found_and_named() {
    let Some(source) = support::shared_data("tunnel.mp4") else {
        return;
    };
    let temp = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/fixtures/overlays");
    let made = Command::new(script)
        .args([&source, temp.path()])
        .status()
        .unwrap();
    assert!(made.success());
    let mut mistaken = Vec::new();
    for folder in paths_in(temp.path()).unwrap() {
        let expected = folder.file_name().unwrap().to_string_lossy().into_owned();
        for video in paths_in(&folder).unwrap() {
            let report = reported(&analyse(&video, &DETECTORS[0], None, &Silent).unwrap());
            let found = match expected.as_str() {
                "mosaic" | "no-mosaic" => largest_mosaic(&report),
                _ => prominent(&report).map_or("none", OverlayClass::name),
            };
            if found != expected {
                mistaken.push(format!("{}: {found}, {report:#?}", video.display()));
            }
        }
    }
    assert!(mistaken.is_empty(), "{}", mistaken.join("\n"));
}

/// The wearer's helmet is always in view, and is not a watermark.
#[test]
fn real_footage_has_nothing_painted_over_it() {
    for name in ["tunnel.mp4", "reef.mp4", "city4k.mp4"] {
        of_real_clip(name, |analysis| {
            let mut report = reported(analysis);
            // The name of a surfer is burnt in for two seconds.
            let is_of_reef = name == "reef.mp4";
            let is_caption = |overlay: &Overlay| overlay.class == OverlayClass::Caption;
            (report.overlays).retain(|overlay| !(is_of_reef && is_caption(overlay)));
            assert_eq!(prominent(&report), None, "{name}: {report:#?}");
        });
    }
}
