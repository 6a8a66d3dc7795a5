//! The boundary detector on synthetic clips with known boundaries.

use std::path::Path;

use omnilife_curate::boundaries::{DETECTORS, Signals};
use omnilife_schemas::records::{Boundary, BoundaryKind};
use omnilife_video::Rgb8Image;
use support::{erp_direction, world_colour};

use crate::support;

const WIDTH: usize = 128;
const HEIGHT: usize = 64;

fn image(colour: impl Fn(usize, usize) -> [f64; 3]) -> Rgb8Image {
    let mut data = Vec::new();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            data.extend(colour(x, y).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    Rgb8Image::new(WIDTH, HEIGHT, data)
}

fn signals(seconds: f64, fps: f64, show: impl Fn(f64, usize, usize) -> [f64; 3]) -> Signals {
    let mut pass = (DETECTORS[0].start)().unwrap();
    for index in 0..(seconds * fps).round() as usize {
        let time = index as f64 / fps;
        pass.observe(time, &image(|x, y| show(time, x, y))).unwrap();
    }
    pass.finish()
}

fn found(seconds: f64, fps: f64, show: impl Fn(f64, usize, usize) -> [f64; 3]) -> Vec<Boundary> {
    (DETECTORS[0].decide)(&signals(seconds, fps, show)).unwrap()
}

/// A camera that yaws by `speed` radians per second in one world.
fn shot(world: usize, speed: f64) -> impl Fn(f64, usize, usize) -> [f64; 3] {
    move |time, x, y| world_colour(world, erp_direction(x, y, WIDTH, HEIGHT, speed * time))
}

#[test]
fn cuts_are_found_to_the_frame_at_any_rate() {
    for fps in [12.5, 24.0, 25.0, 30.0, 60.0, 120.0] {
        let boundaries = found(5.0, fps, |time, x, y| {
            shot(
                [1, 3, 2][usize::from(time >= 2.0) + usize::from(time >= 3.5)],
                0.5,
            )(time, x, y)
        });
        assert_eq!(boundaries.len(), 2, "{fps} fps: {boundaries:?}");
        for (boundary, cut) in boundaries.iter().zip([2.0, 3.5]) {
            let first = (cut * fps - 1e-9_f64).ceil() / fps;
            assert_eq!(boundary.kind, BoundaryKind::Cut, "{fps} fps");
            assert!(
                (boundary.end_seconds - first).abs() < 1e-6,
                "{fps} fps: {boundary:?}"
            );
            assert!((boundary.begin_seconds - first + 1.0 / fps).abs() < 1e-6);
        }
    }
}

#[test]
fn dissolves_are_found_with_their_extent() {
    for (fps, length) in [(25.0, 0.3), (25.0, 0.8), (30.0, 0.5), (60.0, 0.5)] {
        let boundaries = found(5.0, fps, |time, x, y| {
            let share = ((time - 2.0) / length).clamp(0.0, 1.0);
            let (old, new) = (shot(1, 0.2)(time, x, y), shot(3, 0.2)(time, x, y));
            [0, 1, 2].map(|channel| (1.0 - share) * old[channel] + share * new[channel])
        });
        assert_eq!(boundaries.len(), 1, "{fps} fps, {length} s: {boundaries:?}");
        let boundary = &boundaries[0];
        assert_eq!(boundary.kind, BoundaryKind::Gradual);
        assert!((boundary.begin_seconds - 2.0).abs() < 0.12, "{boundary:?}");
        assert!(
            (boundary.end_seconds - 2.0 - length).abs() < 0.12,
            "{boundary:?}"
        );
    }
}

/// Turning, a flash, and a change of exposure are not boundaries.
#[test]
fn one_shot_stays_one_shot() {
    for speed in [0.0, 0.5, 2.0, 6.0] {
        assert_eq!(found(4.0, 30.0, shot(2, speed)), [], "yaw of {speed} rad/s");
    }
    let flash = found(4.0, 30.0, |time, x, y| {
        let level = if (2.0..2.05).contains(&time) {
            0.8
        } else {
            0.0
        };
        shot(1, 0.2)(time, x, y).map(|v| v + level)
    });
    assert_eq!(flash, []);
    // A camera that turns fast and a light that comes up meanwhile.
    let lit = found(4.0, 30.0, |time, x, y| {
        let gain = 1.0 + 0.5 * ((time - 2.0) / 0.4).clamp(0.0, 1.0);
        shot(1, 3.0)(time, x, y).map(|v| v * gain)
    });
    assert_eq!(lit, []);
    let exposure = found(4.0, 30.0, |time, x, y| {
        let gain = if time >= 2.0 { 1.4 } else { 1.0 };
        shot(1, 0.2)(time, x, y).map(|v| v * gain)
    });
    assert_eq!(exposure, []);
}

#[test]
fn empty_and_tiny_videos_have_no_boundaries() {
    assert_eq!(found(0.04, 25.0, shot(1, 0.0)), []);
}

/// A table of another detector is not a video without cuts.
#[test]
fn a_missing_signal_is_an_error() {
    for detector in DETECTORS {
        let error = (detector.decide)(&Signals::default()).unwrap_err();
        assert!(error.to_string().contains(&error.name), "{error}");
        let mut table = signals(1.0, 25.0, shot(1, 0.0));
        table.columns.iter_mut().for_each(|(_, values)| {
            values.pop();
        });
        assert!((detector.decide)(&table).is_err(), "{}", detector.id);
    }
}

/// Written by version 0.1.0 at cbc93b3, through Polars, of the first 30 frames of the street sample:
/// other types of page and columns that may be empty.
#[test]
fn signals_of_an_earlier_version_are_read() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let table = Signals::read_parquet(&golden.join("signals-of-polars.parquet")).unwrap();
    let times: Vec<f64> = table.times.clone();
    assert!(times.len() >= 30 && times.is_sorted(), "{times:?}");
    assert!(!table.columns.is_empty());
    for (name, values) in &table.columns {
        assert_eq!(values.len(), times.len(), "{name}");
        assert!(values.iter().all(|value| value.is_finite()), "{name}");
    }
}

#[test]
fn signals_survive_their_file() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("signals.parquet");
    let table = signals(1.0, 30.0, shot(1, 0.3));
    assert_eq!(table.times.len(), 30);
    table.write_parquet(&path).unwrap();
    assert_eq!(Signals::read_parquet(&path).unwrap(), table);
    std::fs::write(&path, b"PAR1 not really").unwrap();
    let message = Signals::read_parquet(&path).unwrap_err().to_string();
    assert!(
        message.contains("signals.parquet") && !message.contains('\n'),
        "{message}"
    );
}
