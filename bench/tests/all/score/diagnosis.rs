//! Mistakes of convention through scoring and validating.

use std::f64::consts::TAU;

use ::image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use omnilife_bench::{
    DiagnosisKind, ValidationReport, diagnose,
    diagnosis::{ChannelOrder, Encoding, FrameOrder},
    validate,
};
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

/// A frame as a method renders it: at most 5 bytes off.
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
    scene.camera = ErpCamera::new(COLUMNS as u32, ROWS as u32).into();
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

/// Scores and checks views that have one mistake.
fn assert_told(predict: impl Fn(usize) -> Vec<u8>, kind: DiagnosisKind) {
    let bench = bench(predict);
    let diagnosis = diagnose(&bench.request).unwrap();
    let kinds: Vec<DiagnosisKind> = diagnosis.findings.iter().map(|found| found.kind).collect();
    assert_eq!(kinds, [kind]);
    // The last one is that input views are not predicted.
    let warnings = bench.score().unwrap().warnings;
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert_eq!(warnings[..1], diagnosis.warnings());
    assert!(warnings[0].starts_with(DIAGNOSIS_PREFIX));
    let report = validated(&bench);
    assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
    assert_eq!(report.findings[0].view.as_deref(), Some("novel"));
    let line = diagnosis.findings[0].without_view();
    assert_eq!(report.findings[0].reason, line);
    assert_eq!(report.notes, [""; 0]);
}

#[test]
fn one_mistake_is_one_line_of_scoring_and_of_validating() {
    assert_told(in_bgr, DiagnosisKind::Channels(ChannelOrder::Bgr));
    let limited = |frame: usize| -> Vec<u8> {
        let bytes = predicted(frame).into_iter();
        let value = |byte: u8| 16.0 + f64::from(byte) * 219.0 / 255.0;
        bytes.map(|byte| value(byte).round() as u8).collect()
    };
    assert_told(limited, DiagnosisKind::Encoded(Encoding::LimitedRange));
    for pixels in [1, -1] {
        let beside = |frame: usize| {
            let mut bytes = predicted(frame);
            for row in bytes.chunks_exact_mut(3 * COLUMNS) {
                if pixels > 0 {
                    row.rotate_right(3);
                } else {
                    row.rotate_left(3);
                }
            }
            bytes
        };
        let right = 2 * pixels;
        assert_told(beside, DiagnosisKind::Shifted { right, down: 0 });
    }
    // Of the novel view after it.
    let order = DiagnosisKind::Order(FrameOrder::PlacesOn(1));
    assert_told(|frame| predicted(frame + 5), order);
}

/// A baseline may show the nearest input view.
#[test]
fn copies_of_given_views_are_a_note_and_no_warning() {
    let bench = bench(|frame| hills(frame - 1));
    assert_eq!(bench.score().unwrap().warnings.len(), 1);
    let report = validated(&bench);
    assert_eq!(report.findings, []);
    assert_eq!(report.notes.len(), 1, "{:?}", report.notes);
    assert!(report.notes[0].contains("4 of 4"), "{}", report.notes[0]);
}

/// A baseline may mix the given views on both sides; the last novel view has one side alone.
#[test]
fn cross_fades_have_no_finding() {
    let sides = |frame: usize| match frame {
        19 => [17, 18],
        _ => [frame - 1, frame + 1],
    };
    let bench = bench(|frame| {
        let [one, other] = sides(frame).map(hills);
        let values = one.into_iter().zip(other);
        values.map(|(a, b)| a.midpoint(b)).collect()
    });
    assert_eq!(bench.score().unwrap().warnings.len(), 1);
    assert_eq!(validated(&bench).findings, []);
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

/// Programs show such files in different ways, and scores are of the values as they are stored.
#[test]
fn files_that_state_other_colours_are_told() {
    let bench = bench(predicted);
    let as_it_is = bench.score().unwrap().novel_views["psnr"].mean;
    for frame in [4, 9, 14, 19] {
        let file = fs::File::create(bench.at(&format!("novel/{frame:06}.png"))).unwrap();
        let mut encoder = PngEncoder::new(file);
        encoder.set_icc_profile(vec![0; 132]).unwrap();
        let [width, height] = [COLUMNS, ROWS].map(|side| side as u32);
        encoder
            .write_image(&predicted(frame), width, height, ExtendedColorType::Rgb8)
            .unwrap();
    }
    let diagnosis = diagnose(&bench.request).unwrap();
    let kinds: Vec<DiagnosisKind> = diagnosis.findings.iter().map(|found| found.kind).collect();
    assert_eq!(kinds, [DiagnosisKind::OtherColours { files: 4, views: 4 }]);
    let result = bench.score().unwrap();
    assert!(result.warnings[0].contains("other colours than sRGB"));
    assert_eq!(result.novel_views["psnr"].mean, as_it_is);
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
