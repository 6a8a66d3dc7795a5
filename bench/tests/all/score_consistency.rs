//! Scoring accepts only records that belong together and keeps results apart.

use std::{fs, path::Path};

use omnilife_bench::{
    BenchError, MetricChoice, Predictions, ScoreRequest,
    curve::{self, Clock, Region},
    protocols, score, split,
};
use omnilife_schemas::{
    RgbImage, Similarity,
    camera::ErpCamera,
    progress::Silent,
    records::{
        Backend, Edits, ResultRecord, RunRecord, Scene, Split, TraceViews, ValidationStatus,
        ViewPredictions,
    },
    rgb, store,
};
use scenes::scene;
use scoring::{Bench, image};

use crate::{scenes, scoring};

fn run_record(bench: &Bench) -> RunRecord {
    RunRecord {
        method: "stripes".to_owned(),
        variant: None,
        scene: bench.split.scene.clone(),
        protocol_hash: bench.split.protocol_hash.clone(),
        seed: 0,
        hardware: None,
        options: Vec::new(),
        backend: Backend::Cpu { threads: 1 },
        configuration: serde_json::json!({}),
        plan: Vec::new(),
        aids: None,
        evidence: None,
        versions: [].into(),
        inputs: [].into(),
        iterations: 300,
        primitives: 4000,
        training_seconds: 12.5,
        training_cpu_seconds: None,
        planning_seconds: 0.0,
        planning_cpu_seconds: None,
        evaluation_seconds: 0.0,
        rendering_seconds: 1.0,
        rendering_cpu_seconds: None,
        seconds_per_group: None,
        peak_memory_bytes: None,
        camera: None,
        up: None,
        clip_seconds: None,
        stages: Vec::new(),
        views: None,
        normalization: Similarity::new([0.0; 3], 1.0),
        trace: None,
        trace_views: None,
        surfaces: None,
        predictions: ViewPredictions {
            input_views: Some("input".to_owned()),
            novel_views: "novel".to_owned(),
        },
        warnings: vec!["stopped early".to_owned()],
        edits: Edits::default(),
    }
}

#[test]
fn runs_bring_their_folders_and_costs() {
    let bench = Bench::new();
    let run = bench.at("run.json");
    store::write_record(&run, &run_record(&bench)).unwrap();
    let request = ScoreRequest::of_run(
        &bench.request.scene,
        &bench.request.split,
        &run,
        &bench.at("out"),
    )
    .unwrap();
    let result = score(&request, &Silent).unwrap();
    assert_eq!(result.training_seconds, Some(12.5));
    assert_eq!(
        (result.primitives, result.iterations),
        (Some(4000), Some(300))
    );
    assert_eq!(result.warnings, ["stopped early"]);
    assert_eq!(result.novel_views["psnr"].views, 2);
}

/// A run with a trace of three rows, whose novel views get better by one byte from row to row.
fn run_with_trace(bench: &Bench) -> RunRecord {
    let rows = "wall_seconds,evaluation_seconds,cpu_seconds,iteration,primitives,refused_positions\n\
                1,0.5,1,100,1000,0\n\
                2,1,2,200,2000,0\n\
                3,1,3,300,4000,0\n";
    fs::write(bench.at("trace.csv"), rows).unwrap();
    for (iteration, error) in [(100, 4), (200, 3)] {
        let folder = bench.at(&format!("trace/{iteration:06}"));
        fs::create_dir_all(&folder).unwrap();
        for &frame in &bench.split.novel_views {
            let file = folder.join(format!("{frame:06}.png"));
            image(frame as usize, error).write_png(&file).unwrap();
        }
    }
    RunRecord {
        trace: Some("trace.csv".to_owned()),
        trace_views: Some(TraceViews {
            folder: "trace".to_owned(),
            frames: bench.split.novel_views.clone(),
        }),
        ..run_record(bench)
    }
}

#[test]
fn a_curve_is_scored_as_the_predictions_are_and_ends_with_their_means() {
    let mut bench = Bench::new();
    let run = bench.at("run.json");
    store::write_record(&run, &run_with_trace(&bench)).unwrap();
    bench.request.predictions = Predictions::Run(run.clone());
    let result = bench.score().unwrap();
    let traced = curve::read_run(&bench.at("out"), Clock::Wall, Region::Whole).unwrap();
    let last = traced.rows.last().unwrap();
    assert_eq!(last.psnr_db, result.novel_views["psnr"].mean);
    assert_eq!(last.ssim, Some(result.novel_views["ssim"].mean));
    assert!(traced.rows.is_sorted_by(|a, b| a.psnr_db < b.psnr_db));
    // Every value of a view is off by 4 bytes.
    let expected = -20.0 * (4.0_f64 / 255.0).log10();
    assert!((traced.rows[0].psnr_db - expected).abs() < 1e-9);

    // Nothing is computed again, until a view along the training changes.
    let stored = fs::metadata(bench.at("out/curve.csv")).unwrap();
    bench.score().unwrap();
    let again = fs::metadata(bench.at("out/curve.csv")).unwrap();
    assert_eq!(stored.modified().unwrap(), again.modified().unwrap());
    fs::remove_file(bench.at("trace/000200/000004.png")).unwrap();
    let result = bench.score().unwrap();
    let warning = "the curve has no score at iteration 200: 000004.png is missing";
    assert!(result.warnings.iter().any(|line| line == warning));
    let traced = curve::read_run(&bench.at("out"), Clock::Wall, Region::Whole).unwrap();
    let iterations: Vec<u64> = traced.rows.iter().map(|row| row.iteration).collect();
    assert_eq!(iterations, [100, 300]);

    // A run without views along its training has no curve, and no older one stays.
    store::write_record(&run, &run_record(&bench)).unwrap();
    bench.score().unwrap();
    assert!(!bench.at("out/curve.csv").exists());
}

#[test]
fn a_curve_has_lpips_or_the_reason_why_not() {
    let mut bench = Bench::new();
    let mut protocol = protocols::protocol("per-scene").unwrap();
    protocol.metrics = ["psnr", "lpips-alex"].map(str::to_owned).to_vec();
    bench.split = split(&scene(10, &[]), &protocol).unwrap();
    store::write_record(&bench.request.split, &bench.split).unwrap();
    let run = bench.at("run.json");
    store::write_record(&run, &run_with_trace(&bench)).unwrap();
    bench.request.predictions = Predictions::Run(run);
    for metrics in [MetricChoice::All, MetricChoice::WithoutNetworks] {
        let is_left_out = metrics == MetricChoice::WithoutNetworks;
        bench.request.metrics = metrics;
        let result = bench.score().unwrap();
        let traced = curve::read_run(&bench.at("out"), Clock::Wall, Region::Whole).unwrap();
        let lpips = result.novel_views.get("lpips-alex").map(|found| found.mean);
        assert_eq!(traced.rows.last().unwrap().lpips_alex, lpips);
        assert_eq!(traced.final_scores.lpips_alex, lpips);
        let mut lines = result.warnings.iter();
        let is_told = lines.any(|line| line.starts_with("the curve has no lpips-alex: "));
        assert_eq!(is_told, lpips.is_none());
        assert!(is_told || !is_left_out);
    }
}

#[test]
fn runs_of_something_else_are_refused() {
    let mut bench = Bench::new();
    let run = bench.at("run.json");
    bench.request.predictions = Predictions::Run(run.clone());
    let good = run_record(&bench);
    for (record, expected) in [
        (
            RunRecord {
                method: "other".to_owned(),
                ..good.clone()
            },
            "is of method other, not stripes",
        ),
        (
            RunRecord {
                scene: "reef".to_owned(),
                ..good.clone()
            },
            "is of scene reef",
        ),
        (
            RunRecord {
                protocol_hash: "00".to_owned(),
                ..good.clone()
            },
            "is of protocol hash 00",
        ),
        (
            RunRecord {
                inputs: [("split.json".to_owned(), "00".to_owned())].into(),
                ..good
            },
            "was made by another split (sha256 00)",
        ),
    ] {
        store::write_record(&run, &record).unwrap();
        let message = bench.refusal();
        assert!(message.contains(expected), "{message}");
        assert!(message.starts_with(run.to_str().unwrap()), "{message}");
    }
}

#[test]
fn a_run_without_a_component_is_scored_under_a_name_of_its_own() {
    let mut bench = Bench::new();
    let run = bench.at("run.json");
    let record = RunRecord {
        variant: Some("stripes-without-motion".to_owned()),
        ..run_record(&bench)
    };
    store::write_record(&run, &record).unwrap();
    let request = &bench.request;
    let of_run = ScoreRequest::of_run(&request.scene, &request.split, &run, &request.out).unwrap();
    assert_eq!(of_run.method, "stripes-without-motion");
    bench.request.predictions = Predictions::Run(run);
    bench.request.method = of_run.method;
    assert_eq!(bench.score().unwrap().method, "stripes-without-motion");
    // No row claims to be the method itself.
    bench.request.method = "stripes".to_owned();
    let refusal = bench.refusal();
    assert!(
        refusal.contains("is of method stripes-without-motion, not stripes"),
        "{refusal}"
    );
}

#[test]
fn scenes_splits_and_folders_that_do_not_fit_are_refused() {
    let edited = |edit: fn(&mut Split)| {
        let bench = Bench::new();
        let mut split = bench.split.clone();
        edit(&mut split);
        store::write_record(&bench.request.split, &split).unwrap();
        bench.refusal()
    };
    assert!(edited(|split| split.scene = "reef".to_owned()).contains("is of scene reef"));
    assert!(edited(|split| split.novel_views = vec![9]).contains("is not the split"));
    assert!(edited(|split| split.protocol.version = 9).contains("is not the split"));
    assert!(
        edited(|split| {
            split.protocol.metrics = vec!["vmaf".to_owned()];
            split.protocol_hash = split.protocol.hash();
        })
        .contains("there is no metric \"vmaf\"; known: psnr,")
    );
    assert!(
        edited(|split| {
            split.protocol.mask_rule = "static".to_owned();
            split.protocol_hash = split.protocol.hash();
        })
        .contains("mask rule static is not known")
    );

    let bench = Bench::new();
    fs::remove_dir_all(bench.at("novel")).unwrap();
    assert!(bench.refusal().contains("is not a folder of predictions"));

    let bench = Bench::new();
    RgbImage::black(8, 4)
        .write_png(&bench.at("scene/frames/000002.png"))
        .unwrap();
    let message = bench.refusal();
    assert!(message.contains("000002.png: is 8x4 pixels"), "{message}");
    fs::remove_file(bench.at("scene/frames/000002.png")).unwrap();
    assert!(bench.refusal().contains("000002.png: cannot be read"));
    assert!(!bench.at("out/result.json").exists());
}

#[test]
fn the_scores_of_another_method_are_not_overwritten() {
    let mut bench = Bench::new();
    let first = bench.score().unwrap();
    bench.request.method = "other".to_owned();
    let message = bench.refusal();
    assert!(
        message.contains("holds the scores of method stripes"),
        "{message}"
    );
    let stored: ResultRecord = store::read_record(&bench.at("out/result.json")).unwrap();
    assert_eq!(stored, first);
}

#[test]
fn results_whose_inputs_have_changed_do_not_survive_a_failure() {
    let bench = Bench::new();
    bench.score().unwrap();
    let broken = [0; 3 * 8 * 4];
    rgb::write_rgb8_png(&bench.at("scene/frames/000002.png"), 8, 4, &broken).unwrap();
    bench.refusal();
    assert!(!bench.at("out/result.json").exists());
}

/// JPEG ground truth of real size, brought to a smaller width: the frame before as a prediction
/// scores as neighbouring frames do, the frame itself scores the best value.
#[test]
fn real_frames_are_scored() {
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/street/rgb");
    let Ok(entries) = fs::read_dir(&street) else {
        omnilife_schemas::testing::skip(format_args!("{} is not there", street.display()));
        return;
    };
    let mut images: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    images.sort();
    let mut scene = scene(10, &[]);
    scene.camera = ErpCamera::new(1024, 512).into();
    let mut bench = Bench::of(&scene);
    for (frame, entry) in scene.frames.iter_mut().enumerate() {
        entry.image = format!("frames/{frame:06}.jpg");
        fs::copy(&images[frame], bench.at("scene").join(&entry.image)).unwrap();
    }
    store::write_record(&bench.request.scene, &scene).unwrap();
    let mut protocol = protocols::protocol("per-scene").unwrap();
    protocol.largest_width = Some(256);
    protocol.metrics = ["psnr", "ssim"].map(str::to_owned).to_vec();
    let split = split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    for (frame, shown) in [(4, 3), (9, 9)] {
        let image = RgbImage::read(&images[shown]).unwrap();
        let file = bench.at(&format!("novel/{frame:06}.png"));
        image.resized_by_area(256, 128).write_png(&file).unwrap();
    }
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("novel")),
    };
    let result = bench.score().unwrap();
    assert_eq!(result.scored_size, [256, 128]);
    assert!(result.failures.is_empty(), "{:?}", result.failures);
    let scores = ["psnr", "ssim"].map(|metric| 2.0 * result.novel_views[metric].mean);
    let neighbour = [scores[0] - 100.0, scores[1] - 1.0];
    println!("a neighbouring frame scores {neighbour:?}");
    assert!((15.0..40.0).contains(&neighbour[0]), "{neighbour:?}");
    assert!((0.4..0.99).contains(&neighbour[1]), "{neighbour:?}");
}

/// The identity of a scene is its frames and cameras, not its names or warnings.
#[test]
fn results_tell_scenes_of_one_name_apart() {
    let identity = |scene: &Scene| Bench::of(scene).score().unwrap().scene_sha256;
    let original = scene(10, &[]);
    let same = identity(&original);
    assert_eq!(same.len(), 64);
    let mut renamed = original.clone();
    renamed.id = "other/seq-000".to_owned();
    renamed.validation.status = ValidationStatus::Unstable;
    assert_eq!(identity(&renamed), same);
    let mut moved = original.clone();
    moved.frames[3].pose.as_mut().unwrap().centre[1] += 1e-9;
    assert_ne!(identity(&moved), same);
    let mut later = original.clone();
    later.frames[3].time_seconds += 1e-9;
    assert_ne!(identity(&later), same);
    let other_images = Bench::of(&original);
    let frame = other_images.at("scene").join(&original.frames[3].image);
    image(7, 0).write_png(&frame).unwrap();
    assert_ne!(other_images.score().unwrap().scene_sha256, same);
}

#[test]
fn what_is_left_out_is_unavailable_and_the_rest_stays_the_same() {
    let mut bench = Bench::new();
    let whole = score(&bench.request, &Silent).unwrap();
    bench.request.metrics = MetricChoice::only(&["psnr".to_owned()]).unwrap();
    let quick = score(&bench.request, &Silent).unwrap();
    assert_eq!(quick.novel_views["psnr"], whole.novel_views["psnr"]);
    assert!(whole.novel_views.contains_key("ssim"));
    assert!(!quick.novel_views.contains_key("ssim"));
    let reason = quick
        .unavailable
        .iter()
        .find(|missing| missing.view == "novel" && missing.metric == "ssim");
    assert_eq!(reason.unwrap().reason, "left out for a quick look");
    // A quick look does not stand for the whole one.
    bench.request.metrics = MetricChoice::All;
    assert_eq!(score(&bench.request, &Silent).unwrap(), whole);
}

#[test]
fn a_metric_that_does_not_exist_is_refused_by_name() {
    let unknown = MetricChoice::only(&["psnrr".to_owned()]).map_err(BenchError::from);
    let line = unknown.unwrap_err().to_string();
    assert!(line.contains("did you mean \"psnr\"?"), "{line}");
}

/// A frame that is another one than the run was trained on is named in the result's warnings.
#[test]
fn files_of_a_scene_that_changed_after_the_training_are_told() {
    let bench = Bench::new();
    let run = bench.at("run.json");
    let scene = &bench.request.scene;
    let name = store::read_record::<Scene>(scene).unwrap().frames[0]
        .image
        .clone();
    for (trained, warnings) in [
        (store::sha256_file(&scene.with_file_name(&name)).unwrap(), 1),
        ("0".repeat(64), 2),
    ] {
        let record = RunRecord {
            inputs: [(name.clone(), trained)].into(),
            ..run_record(&bench)
        };
        store::write_record(&run, &record).unwrap();
        let (split, out) = (&bench.request.split, bench.at(&format!("out-{warnings}")));
        let request = ScoreRequest::of_run(scene, split, &run, &out).unwrap();
        let result = score(&request, &Silent).unwrap();
        assert_eq!(result.warnings.len(), warnings, "{:?}", result.warnings);
        let is_named = result.warnings.iter().any(|line| line.contains(&name));
        assert_eq!(is_named, warnings == 2);
    }
}
