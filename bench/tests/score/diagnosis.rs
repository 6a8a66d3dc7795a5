//! Mistakes of convention through scoring and validating.

use std::f64::consts::TAU;

use omnilife_bench::{DiagnosisKind, ValidationReport, diagnose, validate};
use omnilife_schemas::{camera::ErpCamera, progress::Silent, records::DIAGNOSIS_PREFIX};

use super::*;

const COLUMNS: usize = 128;
const ROWS: usize = 64;

/// The bytes of a panorama in which something moves from frame to frame.
fn hills(frame: usize) -> Vec<u8> {
    let pixels = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (column, row)));
    pixels
        .flat_map(|(column, row)| {
            let longitude = TAU * (column as f64 + 0.5) / COLUMNS as f64;
            let height = (row as f64 + 0.5) / ROWS as f64;
            let seen = longitude + 0.05 * frame as f64 * longitude.sin() * height;
            let wave = |turns: f64, phase: f64| {
                (turns * seen + phase + 5.0 * height * (0.7 * turns).sin()).sin()
            };
            let red = 50.0 * wave(1.0, 0.3) + 30.0 * wave(3.0, 1.1) + 20.0 * wave(7.0, 2.0);
            let green = 40.0 * wave(2.0, 0.9) + 30.0 * wave(3.0, 1.4) + 15.0 * wave(9.0, 0.2);
            let blue = 45.0 * wave(1.0, 2.6) + 30.0 * wave(5.0, 0.4) + 15.0 * wave(6.0, 1.9);
            [120.0 + red, 120.0 + green, 110.0 + blue].map(|value| value.round() as u8)
        })
        .collect()
}

/// What a method makes of a frame: at most 5 bytes off.
fn predicted(frame: usize) -> Vec<u8> {
    let bytes = hills(frame).into_iter().enumerate();
    bytes
        .map(|(at, byte)| byte.saturating_add_signed((at * 37 % 11) as i8 - 5))
        .collect()
}

fn write(bytes: &[u8], file: &std::path::Path) {
    RgbImage::from_rgb8(COLUMNS, ROWS, bytes)
        .write_png(file)
        .unwrap();
}

/// A scene of 20 frames of hills, of which the novel views 4, 9, 14 and 19 are predicted.
fn bench(predict: impl Fn(usize) -> Vec<u8>) -> Bench {
    let mut scene = scene(20, &[]);
    scene.camera = ErpCamera {
        width: COLUMNS as u32,
        height: ROWS as u32,
    }
    .into();
    let mut bench = Bench::of(&scene);
    for (frame, entry) in scene.frames.iter().enumerate() {
        write(&hills(frame), &bench.at("scene").join(&entry.image));
    }
    for &frame in &bench.split.novel_views {
        let file = bench.at(&format!("novel/{frame:06}.png"));
        write(&predict(frame as usize), &file);
    }
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("novel")),
    };
    bench
}

fn validated(bench: &Bench) -> ValidationReport {
    let request = &bench.request;
    validate(
        &request.scene,
        &request.split,
        &request.predictions,
        &Silent,
    )
    .unwrap()
}

fn in_bgr(frame: usize) -> Vec<u8> {
    let bytes = predicted(frame);
    let pixels = bytes.as_chunks::<3>().0.iter();
    pixels
        .flat_map(|[red, green, blue]| [*blue, *green, *red])
        .collect()
}

#[test]
fn mistakes_are_the_first_warnings_and_change_no_score() {
    let bench = bench(in_bgr);
    let result = bench.score().unwrap();
    assert_eq!(result.warnings.len(), 2, "{:?}", result.warnings);
    assert!(result.warnings[0].starts_with(DIAGNOSIS_PREFIX));
    assert!(result.warnings[0].contains("BGR"), "{}", result.warnings[0]);
    assert_eq!(result.failures, []);
    let psnr = |frame: usize| {
        let [prediction, truth] = [in_bgr(frame), hills(frame)];
        let squares = prediction.iter().zip(&truth);
        let squares = squares.map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2));
        let count = truth.len() as f64;
        -10.0 * (squares.sum::<f64>() / count / 255.0 / 255.0).log10()
    };
    let mean = [4, 9, 14, 19].map(psnr).iter().sum::<f64>() / 4.0;
    assert!((result.novel_views["psnr"].mean - mean).abs() < 1e-4);

    let report = validated(&bench);
    assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
    assert_eq!(report.findings[0].view.as_deref(), Some("novel"));
    assert!(report.findings[0].reason.contains("BGR"));
    assert_eq!(report.notes, [""; 0]);

    let diagnosis = diagnose(&bench.request).unwrap();
    assert_eq!((diagnosis.views, diagnosis.findings.len()), (4, 1));
    assert!(matches!(
        diagnosis.findings[0].kind,
        DiagnosisKind::Channels(order) if order.name() == "BGR"
    ));
    assert!(diagnosis.findings[0].gain_db.unwrap() > 5.0);
}

#[test]
fn right_views_have_no_finding() {
    let bench = bench(predicted);
    assert_eq!(bench.score().unwrap().warnings.len(), 1);
    let report = validated(&bench);
    assert_eq!((report.findings, report.notes), (Vec::new(), Vec::new()));
}

#[test]
fn views_of_the_next_novel_frame_are_found() {
    let bench = bench(|frame| predicted(frame + 5));
    let diagnosis = diagnose(&bench.request).unwrap();
    let kinds: Vec<DiagnosisKind> = diagnosis.findings.iter().map(|found| found.kind).collect();
    assert!(
        matches!(kinds[..], [DiagnosisKind::Order(_)]),
        "{:?}",
        diagnosis.findings
    );
}

/// A baseline may show the given view that is nearest.
#[test]
fn copies_of_given_views_are_a_note_and_no_warning() {
    let bench = bench(|frame| hills(frame - 1));
    assert_eq!(bench.score().unwrap().warnings.len(), 1);
    let report = validated(&bench);
    assert_eq!(report.findings, []);
    assert_eq!(report.notes.len(), 1, "{:?}", report.notes);
    assert!(report.notes[0].contains("4 of 4"), "{}", report.notes[0]);
}

#[test]
fn frames_that_are_given_and_held_out_are_told_of_the_data() {
    let bench = bench(predicted);
    write(&hills(8), &bench.at("scene/frames/000009.png"));
    write(&predicted(8), &bench.at("novel/000009.png"));
    let warnings = bench.score().unwrap().warnings;
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(!warnings[0].starts_with(DIAGNOSIS_PREFIX));
    assert!(warnings[0].contains("1 of 4"), "{}", warnings[0]);
    let report = validated(&bench);
    assert_eq!((report.findings, report.notes.len()), (Vec::new(), 1));
}

/// Cut values are told where they are few, and are another range where they are many.
#[test]
fn arrays_beyond_the_range_are_told() {
    let bench = bench(predicted);
    let array = |frame: u32, change: &dyn Fn(usize, f32) -> f32| {
        let name = bench.at(&format!("novel/{frame:06}"));
        drop(fs::remove_file(name.with_extension("png")));
        let bytes = predicted(frame as usize).into_iter().enumerate();
        let values: Vec<f32> = bytes
            .map(|(at, byte)| change(at, f32::from(byte) / 255.0))
            .collect();
        npy::write_f32(&name.with_extension("npy"), &[ROWS, COLUMNS, 3], &values).unwrap();
    };
    for frame in [4, 9, 14, 19] {
        array(frame, &|at, value| {
            if at % 10 == 0 { value + 1.0 } else { value }
        });
    }
    let result = bench.score().unwrap();
    assert_eq!(result.failures, []);
    let told = |line: &&String| line.starts_with(DIAGNOSIS_PREFIX) && line.contains("10 %");
    assert_eq!(
        result.warnings.iter().filter(told).count(),
        1,
        "{:?}",
        result.warnings
    );
    array(4, &|_, value| 2.0 * value - 1.0);
    array(9, &|_, value| (value - 0.45) / 0.22);
    array(14, &|at, _| if at % 5 == 0 { 2.0 } else { 0.0 });
    let failures = bench.score().unwrap().failures;
    let frames: Vec<u32> = failures.iter().map(|failure| failure.frame).collect();
    assert_eq!(frames, [4, 9, 14], "{failures:?}");
}
