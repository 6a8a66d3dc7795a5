//! A search of the compressed stream's candidates alone finds the same as the whole search.

use std::path::Path;

use omnilife_curate::{
    analysis::{Analysis, analyse},
    boundaries::{
        DETECTORS,
        key_frame_prefilter::{self, KeyFramePrefilter},
    },
};
use omnilife_schemas::{progress::Silent, records::Boundary};

use crate::footage::{
    of_real_clip,
    support::{Clip, erp_direction, world_colour},
};

fn both(path: &Path, analysis: &Analysis) -> (Vec<Boundary>, KeyFramePrefilter) {
    let whole = (DETECTORS[0].decide)(&analysis.signals).unwrap();
    (
        whole,
        key_frame_prefilter::search(path, &DETECTORS[0], &Silent).unwrap(),
    )
}

fn assert_same(name: &str, whole: &[Boundary], fast: &[Boundary], tolerance_seconds: f64) {
    assert_eq!(whole.len(), fast.len(), "{name}: {whole:?} and {fast:?}");
    for (a, b) in whole.iter().zip(fast) {
        let apart = (a.begin_seconds - b.begin_seconds)
            .abs()
            .max((a.end_seconds - b.end_seconds).abs());
        assert!(apart <= tolerance_seconds, "{name}: {a:?} and {b:?}");
    }
}

#[test]
fn cuts_are_found_in_a_third_of_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shots.mp4");
    let (width, height, frames) = (128, 64, 360);
    // The encoder places a key frame every 12 frames.
    let cuts = [101, 240];
    Clip::steady(width, height, frames, 30).write(&path, |frame, x, y| {
        let world = cuts.iter().filter(|&&cut| frame >= cut).count();
        let yaw = 0.01 * frame as f64;
        world_colour(world, erp_direction(x, y, width, height, yaw))
    });
    let (whole, fast) = both(
        &path,
        &analyse(&path, &DETECTORS[0], None, &Silent).unwrap(),
    );
    assert_eq!(whole.len(), cuts.len());
    assert_same("shots", &whole, &fast.boundaries, 1e-9);
    assert_eq!((fast.segments, fast.frames), (30, 360));
    // Two with a cut, and the last, which has no other side.
    assert_eq!(fast.candidate, 3);
    assert!(fast.decoded_frames < 180, "{fast:?}");
}

#[test]
fn a_flash_between_two_key_frames_is_looked_at_and_is_no_boundary() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flash.mp4");
    let (width, height) = (128, 64);
    Clip::steady(width, height, 240, 30).write(&path, |frame, x, y| {
        let colour = world_colour(1, erp_direction(x, y, width, height, 0.0));
        let light = if frame == 101 { 0.9 } else { 0.0 };
        colour.map(|value| value + (1.0 - value) * light)
    });
    let (whole, fast) = both(
        &path,
        &analyse(&path, &DETECTORS[0], None, &Silent).unwrap(),
    );
    assert_eq!(whole, []);
    assert_eq!(fast.boundaries, []);
    // The flash and the last segment, and at most one beside the flash.
    assert!((2..=3).contains(&fast.candidate), "{fast:?}");
}

#[test]
fn real_clips_give_the_same_boundaries() {
    for name in ["bikes.mp4", "tunnel.mp4"] {
        of_real_clip(name, |path, analysis| {
            let (whole, fast) = both(path, analysis);
            println!(
                "{name}: {} of {} segments, {} frames decoded for {}",
                fast.candidate, fast.segments, fast.decoded_frames, fast.frames
            );
            assert_same(name, &whole, &fast.boundaries, 0.1);
        });
    }
}
