//! Predictions checked before they are scored; scores of two methods compared.

use std::fs;

use omnilife_bench::{Predictions, StoredResult, WinsAndLosses, compare, split, validate};
use omnilife_schemas::{
    Classified, ErrorKind, RgbImage, progress::Silent, records::Scene, rgb::Mask, store,
};
use scenes::{HEIGHT, WIDTH, scene};
use scoring::{Bench, image};

use crate::{scenes, scoring};

fn findings(bench: &Bench) -> Vec<String> {
    let request = &bench.request;
    let report = validate(
        &request.scene,
        &request.split,
        &request.predictions,
        &Silent,
    )
    .unwrap();
    let findings = report.findings.iter();
    findings
        .map(|f| format!("{}: {}", f.view.as_deref().unwrap_or("stray"), f.reason))
        .collect()
}

#[test]
fn usable_predictions_have_no_findings() {
    let mut bench = Bench::new();
    assert_eq!(findings(&bench), [""; 0]);
    // Nobody takes these for predictions.
    for name in ["novel/contact.jpg", "novel/metrics.npz"] {
        fs::write(bench.at(name), b"").unwrap();
    }
    assert_eq!(findings(&bench), [""; 0]);
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("novel")),
    };
    assert_eq!(findings(&bench), [""; 0]);
}

#[test]
fn every_bad_file_is_listed() {
    let bench = Bench::new();
    let file = |frame: u32| bench.at("input").join(format!("{frame:06}.png"));
    fs::remove_file(file(0)).unwrap();
    image(1, 1)
        .resized_by_area(WIDTH / 2, HEIGHT / 2)
        .write_png(&file(1))
        .unwrap();
    image::GrayImage::new(WIDTH as u32, HEIGHT as u32)
        .save(file(2))
        .unwrap();
    RgbImage::black(WIDTH, HEIGHT).write_png(&file(3)).unwrap();
    image(5, 0).write_png(&file(5)).unwrap();
    fs::copy(file(6), file(7)).unwrap();
    fs::copy(file(6), bench.at("novel/000010.png")).unwrap();
    assert_eq!(
        findings(&bench),
        [
            "input: 000000.png is missing",
            "input: 000001.png is 16x8 pixels, expected 32x16",
            "input: 000002.png is L8, expected 8-bit RGB",
            "input: 000003.png is black",
            "input: 000005.png is the ground truth, byte for byte",
            "input: 000007.png is the same image as that of input view 6",
            "stray: 000010.png is not among the scored views",
        ]
    );
    assert!(!bench.at("out").exists(), "nothing is written");
    let failed = bench.score().unwrap().failures;
    let failed: Vec<String> = failed
        .iter()
        .map(|f| format!("{}: {}", f.view, f.reason))
        .collect();
    assert_eq!(
        failed,
        findings(&bench)[..3],
        "scoring fails on the same files"
    );
}

/// A scene whose frames show the camera operator in their lower half.
#[test]
fn what_is_predicted_where_nothing_counts_is_looked_at_and_not_shown() {
    let mut scene = scene(10, &[]);
    for frame in &mut scene.frames {
        frame.ignore_mask = Some("holder.png".to_owned());
    }
    let bench = Bench::of(&scene);
    let marks = (0..WIDTH * HEIGHT).map(|at| 255 * u8::from(at / WIDTH >= HEIGHT / 2));
    let mask = Mask::new(WIDTH, HEIGHT, marks.collect());
    let file = bench.request.scene.with_file_name("holder.png");
    mask.write_png(&file).unwrap();
    let result = bench.score().unwrap();
    let told = "10 of 10 scored views have ignored pixels, which no score counts";
    assert!(
        result.warnings.iter().any(|line| line == told),
        "{:?}",
        result.warnings
    );
    // Predictions are off by one and two bytes everywhere, as without the mask.
    assert!((result.novel_views["psnr"].mean - psnr(2.0)).abs() < 1e-9);
    let image = RgbImage::read(&bench.at("out/comparisons/novel-000004.png")).unwrap();
    let levels = |row: usize| {
        let row = &image.data[3 * image.width * row..3 * image.width * (row + 1)];
        [row[0], row[3 * (image.width - 1)]]
    };
    let grey = 128.0 / 255.0;
    assert_eq!(levels(HEIGHT - 1), [grey; 2]);
    assert_ne!(levels(0), [grey; 2]);

    let input = |frame: u32| bench.at("input").join(format!("{frame:06}.png"));
    RgbImage::black(WIDTH, HEIGHT).write_png(&input(3)).unwrap();
    fs::copy(input(6), input(7)).unwrap();
    assert_eq!(
        findings(&bench),
        [
            "input: 000003.png is black",
            "input: 000007.png is the same image as that of input view 6",
        ]
    );
    mask_of_all().write_png(&file).unwrap();
    assert!(
        bench
            .refusal()
            .contains("holder.png: leaves nothing of frame")
    );
}

fn mask_of_all() -> Mask {
    Mask::new(WIDTH, HEIGHT, vec![255; WIDTH * HEIGHT])
}

#[test]
fn what_scoring_refuses_cannot_be_checked() {
    let mut bench = Bench::new();
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("nowhere")),
    };
    let request = &bench.request;
    let checked = validate(
        &request.scene,
        &request.split,
        &request.predictions,
        &Silent,
    );
    assert_eq!(checked.unwrap_err().to_string(), bench.refusal());
}

/// Scores a scene whose novel views are off by `errors` bytes, as a method of this name.
fn result(scene_id: &str, method: &str, errors: [u8; 2]) -> (Bench, StoredResult) {
    let mut scene = scene(10, &[]);
    scene.id = scene_id.to_owned();
    let mut bench = Bench::of(&scene);
    for (frame, error) in [4, 9].into_iter().zip(errors) {
        let file = bench.at(&format!("novel/{frame:06}.png"));
        image(frame, error).write_png(&file).unwrap();
    }
    bench.request.method = method.to_owned();
    let stored = bench.stored();
    (bench, stored)
}

impl Bench {
    fn stored(&self) -> StoredResult {
        (self.request.out.join("result.json"), self.score().unwrap())
    }
}

fn psnr(error: f64) -> f64 {
    -20.0 * (error / 255.0).log10()
}

#[test]
fn differences_are_paired_by_scene_and_view() {
    let (_a1, a1) = result("one/seq-000", "a", [1, 2]);
    let (_a2, a2) = result("two/seq-000", "a", [1, 1]);
    let (_a3, a3) = result("three/seq-000", "a", [1, 1]);
    let (_b1, b1) = result("one/seq-000", "b", [2, 1]);
    let (_b2, b2) = result("two/seq-000", "b", [3, 3]);
    let comparison = compare(&[a1, a2, a3], &[b1, b2]).unwrap();
    assert_eq!(comparison.methods, ["a", "b"]);
    assert_eq!(comparison.scenes, ["one/seq-000", "two/seq-000"]);
    assert_eq!(comparison.left_out, ["three/seq-000: b has no result"]);
    let difference = |view: &str, metric: &str| {
        let mut differences = comparison.differences.iter();
        differences
            .find(|d| d.view == view && d.metric == metric)
            .unwrap()
    };
    let novel = difference("novel", "psnr");
    let gain = psnr(1.0) - psnr(3.0);
    assert!((novel.mean - gain / 2.0).abs() < 1e-9, "{}", novel.mean);
    // Scene by scene the difference is 0 and the whole gain: so are the ends of the interval.
    let [low, high] = novel.interval.unwrap();
    assert!(
        low.abs() < 1e-9 && (high - gain).abs() < 1e-9,
        "{low} {high}"
    );
    let counts = |wins, losses, ties| WinsAndLosses { wins, losses, ties };
    assert_eq!(novel.scenes.wins, 1);
    assert_eq!(novel.views, counts(3, 1, 0));
    assert_eq!(difference("input", "psnr").views, counts(0, 0, 16));
}

#[test]
fn scores_of_other_rules_or_scenes_are_refused_with_the_difference() {
    let (_a, a) = result("one/seq-000", "a", [1, 2]);
    let (bench, b) = result("one/seq-000", "b", [1, 2]);
    let refusal = |b: &StoredResult| {
        let error = compare(std::slice::from_ref(&a), std::slice::from_ref(b)).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        error.to_string()
    };
    let mut other = b.clone();
    other.1.scene_sha256 = "0".repeat(64);
    assert!(refusal(&other).contains("is of another scene one/seq-000 (000000000000)"));

    let stored: Scene = store::read_record(&bench.request.scene).unwrap();
    let mut protocol = bench.split.protocol.clone();
    protocol.largest_width = Some(16);
    let rules = split(&stored, &protocol).unwrap();
    store::write_record(&bench.request.split, &rules).unwrap();
    for kind in ["input", "novel"] {
        for frame in 0..10 {
            let file = bench.at(&format!("{kind}/{frame:06}.png"));
            if file.exists() {
                image(frame, 3)
                    .resized_by_area(16, 8)
                    .write_png(&file)
                    .unwrap();
            }
        }
    }
    fs::remove_dir_all(&bench.request.out).unwrap();
    let message = refusal(&bench.stored());
    assert!(
        message.ends_with(": largest_width is 16, not null"),
        "{message}"
    );
}

#[test]
fn failures_and_mixed_methods_are_not_compared() {
    let (bench, a) = result("one/seq-000", "a", [1, 2]);
    let (_b, b) = result("one/seq-000", "b", [1, 2]);
    let message = |a: &[StoredResult], b: &[StoredResult]| compare(a, b).unwrap_err().to_string();
    let of_b = [b.clone()];
    assert!(message(&[a, b], &of_b).contains("one method each"));
    assert!(message(&[], &of_b).contains("nothing to compare"));
    fs::remove_file(bench.at("novel/000004.png")).unwrap();
    let mut stored = bench.stored();
    let failed = message(std::slice::from_ref(&stored), &of_b);
    assert!(
        failed.contains("one/seq-000: a: novel view 4 could not be scored: "),
        "{failed}"
    );
    // All its views have scores, and its run failed all the same.
    stored.1.failures.clear();
    stored.1.run_failure = Some("train ended with exit code 1".to_owned());
    let failed = message(&[stored], &of_b);
    assert!(
        failed.contains("one/seq-000: a: the run failed: train ended with exit code 1"),
        "{failed}"
    );
}

/// A foreign table is read as it is, byte by byte: for any content, the comparison is refused in one line.
#[test]
fn damaged_tables_of_views_are_refused() {
    let (_a, a) = result("one/seq-000", "a", [1, 2]);
    let (bench, b) = result("one/seq-000", "b", [1, 2]);
    let file = bench.at("out/frames.csv");
    let whole = fs::read(&file).unwrap();
    for damaged in [
        b"PAR1\x15\x04\x15\xff\xff\xff\x7fPAR1".to_vec(),
        vec![0; 4096],
        Vec::new(),
        whole[..whole.len() / 2].to_vec(),
    ] {
        fs::write(&file, damaged).unwrap();
        let error = compare(std::slice::from_ref(&a), std::slice::from_ref(&b)).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User, "{error}");
        let message = error.to_string();
        assert!(
            message.contains("frames.csv: must be a table of views"),
            "{message}"
        );
        assert!(!message.contains('\n'), "{message}");
    }
    // Whole lines, and not all of them.
    let lines: Vec<&[u8]> = whole.split_inclusive(|&byte| byte == b'\n').collect();
    fs::write(&file, lines[..lines.len() - 3].concat()).unwrap();
    let error = compare(std::slice::from_ref(&a), std::slice::from_ref(&b)).unwrap_err();
    assert!(error.to_string().contains("scores of the"), "{error}");
}
