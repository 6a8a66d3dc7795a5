//! Reports of scoring besides scores.

use super::*;

#[test]
fn equal_images_are_told() {
    let bench = Bench::new();
    image(4, 0)
        .write_png(&bench.at("novel/000004.png"))
        .unwrap();
    let result = bench.score().unwrap();
    assert_eq!(
        result.warnings,
        [
            "1 of 10 predictions are the ground truth, byte for byte: their PSNR is infinite and \
          counts as 100 dB"
        ]
    );
    let summary = result.novel_views["psnr"];
    let (low, high) = (flat_psnr(2.0), 100.0);
    assert!((summary.mean - (low + high) / 2.0).abs() < 1e-9);
    let deviation = (high - low) / 2.0_f64.sqrt();
    assert!((summary.standard_deviation.unwrap() - deviation).abs() < 1e-9);
}

/// Every metric of a protocol has a value or a reason.
#[test]
fn no_metric_of_a_protocol_is_passed_over() {
    let bench = Bench::new();
    let whole = omnilife_bench::protocols::protocol("per-scene").unwrap();
    let ids: Vec<&str> = whole.metrics.iter().map(String::as_str).collect();
    with_metrics(&bench, &ids);
    let result = bench.score().unwrap();
    for (kind, views) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        let unavailable = result.unavailable.iter().filter(|u| u.view == kind);
        let mut told: Vec<&str> = unavailable.map(|u| u.metric.as_str()).collect();
        told.extend(views.keys().map(String::as_str));
        told.sort_unstable();
        let mut asked = ids.clone();
        asked.sort_unstable();
        assert_eq!(told, asked);
        assert!(views.contains_key("ws-ssim") && !views.contains_key("psnr-human"));
    }
}

#[test]
fn kinds_of_view_without_predictions_are_told() {
    let mut bench = Bench::new();
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("novel")),
    };
    let result = bench.score().unwrap();
    assert!(result.input_views.is_empty() && result.failures.is_empty());
    assert_eq!(
        result.warnings,
        ["input views were not scored: no predictions given"]
    );
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: None,
    };
    assert!(bench.refusal().starts_with("nothing to score"));
}

#[test]
fn stray_predictions_unposed_frames_and_doubtful_poses_are_told() {
    let mut doubtful = scene(12, &[3, 7]);
    doubtful.validation.status = ValidationStatus::Unstable;
    doubtful.validation.problems = vec!["too few points".to_owned(), "jumps".to_owned()];
    let bench = Bench::of(&doubtful);
    image(3, 0)
        .write_png(&bench.at("novel/frame3.png"))
        .unwrap();
    assert_eq!(
        bench.score().unwrap().warnings,
        [
            "the predictions hold 1 image beyond the scored views",
            "2 of 12 frames have no pose and are not scored",
            "the scene's poses are unstable: too few points; jumps",
        ]
    );
}
