//! Scoring of folders of predictions, with every possible fault.

mod diagnosis;
mod masks_and_truth;
mod moved_scene;
mod objects;
mod padded_frames;
mod regions;
mod repeated;
mod reports;

use std::{collections::BTreeSet, fs, sync::Mutex};

use omnilife_bench::{METRICS, Metric, Need, Predictions, Sample, ViewPair, score};
use omnilife_schemas::{
    RgbImage,
    camera::PinholeCamera,
    frame_scores::FrameScores,
    npy,
    progress::Progress,
    records::{DepthImage, ResultRecord, Scene, ValidationStatus},
    rgb::Mask,
    store,
};
use scenes::{HEIGHT, WIDTH, scene};
use scoring::{Bench, image};

use crate::{scenes, scoring};

/// Keeps what is reported.
#[derive(Default)]
struct Recorder {
    notes: Mutex<Vec<String>>,
    steps: Mutex<u64>,
}

impl Progress for Recorder {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, steps: u64) {
        *self.steps.lock().unwrap() += steps;
    }
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, line: &str) {
        self.notes.lock().unwrap().push(line.to_owned());
    }
}

/// PSNR of images that differ by `error` bytes everywhere.
fn flat_psnr(error: f64) -> f64 {
    -20.0 * (error / 255.0).log10()
}

/// A protocol with these metrics in place of its own, for the scene and predictions of `bench`.
fn with_metrics(bench: &Bench, metrics: &[&str]) {
    let mut protocol = omnilife_bench::protocols::protocol("per-scene").unwrap();
    protocol.metrics = metrics.iter().map(|&id| id.to_owned()).collect();
    let scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
}

/// Returns true if a metric needs only images, possibly of an ERP camera.
fn needs_images(metric: &Metric) -> bool {
    metric.needs.iter().all(|need| *need == Need::Sphere)
}

#[test]
fn views_are_scored_and_written() {
    let bench = Bench::new();
    let recorder = Recorder::default();
    let result = score(&bench.request, &recorder).unwrap();
    assert_eq!(*recorder.steps.lock().unwrap(), 10);
    assert_eq!(
        (result.method.as_str(), result.scene.as_str()),
        ("stripes", "stripes/seq-000")
    );
    assert_eq!(result.protocol, "per-scene/2");
    assert_eq!(result.protocol_hash, bench.split.protocol_hash);
    assert_eq!(result.scored_size, [WIDTH as u32, HEIGHT as u32]);
    assert_eq!((result.failures.len(), result.warnings.len()), (0, 0));
    for (views, error, count) in [(&result.input_views, 1.0, 8), (&result.novel_views, 2.0, 2)] {
        assert_eq!(views.keys().collect::<Vec<_>>(), ["psnr", "ssim"]);
        assert_eq!(views["psnr"].views, count);
        assert!((views["psnr"].mean - flat_psnr(error)).abs() < 1e-9);
        assert!(views["ssim"].mean < 1.0 && views["ssim"].mean > 0.9);
    }
    let out = bench.at("out");
    assert_eq!(
        store::names_in(&out).unwrap(),
        [
            ".done",
            "comparisons",
            "frames.csv",
            "result.json",
            "scoring.json"
        ]
    );
    assert_eq!(
        store::names_in(&out.join("comparisons")).unwrap(),
        ["novel-000004.png", "novel-000009.png"]
    );
    let stored: ResultRecord = store::read_record(&out.join("result.json")).unwrap();
    assert_eq!(stored, result);
}

#[test]
fn comparisons_show_the_prediction_left_of_the_truth() {
    let bench = Bench::new();
    bench.score().unwrap();
    let comparison = RgbImage::read(&bench.at("out/comparisons/novel-000009.png")).unwrap();
    let separator = comparison.width - 2 * WIDTH;
    assert_eq!((separator, comparison.height), (4, HEIGHT));
    let bytes = comparison.to_rgb8();
    let (prediction, truth) = (image(9, 2).to_rgb8(), image(9, 0).to_rgb8());
    for row in 0..HEIGHT {
        let line = &bytes[row * comparison.width * 3..(row + 1) * comparison.width * 3];
        let range = row * WIDTH * 3..(row + 1) * WIDTH * 3;
        assert_eq!(line[..WIDTH * 3], prediction[range.clone()]);
        assert_eq!(line[WIDTH * 3..(WIDTH + separator) * 3], [255; 12]);
        assert_eq!(line[(WIDTH + separator) * 3..], truth[range]);
    }
}

#[test]
fn the_table_has_a_row_for_every_view() {
    let bench = Bench::new();
    fs::remove_file(bench.at("novel/000004.png")).unwrap();
    bench.score().unwrap();
    let table = FrameScores::read(&bench.at("out/frames.csv")).unwrap();
    assert_eq!(table.metrics, bench.split.protocol.metrics);
    let frames: Vec<u32> = table.rows.iter().map(|row| row.frame).collect();
    assert_eq!(frames, [0, 1, 2, 3, 5, 6, 7, 8, 4, 9]);
    assert_eq!(table.rows[9].time_seconds, 0.1 * 9.0);
    assert_eq!(
        (&*table.rows[7].view, &*table.rows[8].view),
        ("input", "novel")
    );
    // The first of the two novel views failed: it is a row without scores.
    assert!(table.rows[8].scores.iter().all(Option::is_none));
    let psnr: Vec<f64> = table.of("novel", "psnr").unwrap().collect();
    assert_eq!(psnr.len(), 1);
    assert!((psnr[0] - flat_psnr(2.0)).abs() < 1e-9);
}

/// Dynamic masks: one frame has none, one an empty one.
#[test]
fn masked_scores_are_means_over_the_frames_that_have_them() {
    let mut masked = scene(10, &[]);
    masked.frames[4].mask = Some("masks/4.png".to_owned());
    masked.frames[3].mask = Some("masks/3.png".to_owned());
    let bench = Bench::of(&masked);
    fs::create_dir(bench.at("scene/masks")).unwrap();
    let mask = |data: Vec<u8>| Mask::new(WIDTH, HEIGHT, data);
    let left_half = (0..WIDTH * HEIGHT).map(|at| 255 * u8::from(at % WIDTH < WIDTH / 2));
    mask(left_half.collect())
        .write_png(&bench.at("scene/masks/4.png"))
        .unwrap();
    mask(vec![0; WIDTH * HEIGHT])
        .write_png(&bench.at("scene/masks/3.png"))
        .unwrap();
    with_metrics(
        &bench,
        &["psnr-dynamic", "psnr-static", "psnr-human", "depth-delta"],
    );
    let result = bench.score().unwrap();
    let novel = result.novel_views["psnr-dynamic"];
    assert_eq!((novel.views, novel.undefined_views), (1, 1));
    assert_eq!(novel.standard_deviation, None);
    assert!((novel.mean - flat_psnr(2.0)).abs() < 1e-9);
    assert_eq!(result.input_views["psnr-static"].views, 1);
    let unavailable: Vec<_> = result
        .unavailable
        .iter()
        .map(|u| format!("{} {}: {}", u.view, u.metric, u.reason))
        .collect();
    assert_eq!(
        unavailable,
        [
            "input psnr-dynamic: undefined for every view: the frame has no mask",
            "input psnr-human: the scene has no masks of class human",
            "input depth-delta: the depth of the scene is not known",
            "novel psnr-human: the scene has no masks of class human",
            "novel depth-delta: the depth of the scene is not known",
        ]
    );
    // Another mask is another scene to these metrics.
    let before = result.scene_sha256;
    mask(vec![255; WIDTH * HEIGHT])
        .write_png(&bench.at("scene/masks/4.png"))
        .unwrap();
    assert_ne!(bench.score().unwrap().scene_sha256, before);
    // A mask of another size is not a mask of the frame.
    mask(vec![255; WIDTH * HEIGHT])
        .resized_to_nearest(5, 3)
        .write_png(&bench.at("scene/masks/4.png"))
        .unwrap();
    assert!(bench.refusal().contains("is 5x3 pixels, scene"));
}

#[test]
fn predicted_depth_is_scored_where_the_scene_knows_it() {
    let mut deep = scene(10, &[]);
    for (number, frame) in deep.frames.iter_mut().enumerate() {
        frame.depth = Some(DepthImage {
            file: format!("depth/{number}.png"),
            unit: 0.01,
        });
    }
    let bench = Bench::of(&deep);
    fs::create_dir(bench.at("scene/depth")).unwrap();
    for number in 0..10 {
        let depth = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(
            WIDTH as u32,
            HEIGHT as u32,
            image::Luma([200]),
        );
        depth
            .save(bench.at(&format!("scene/depth/{number}.png")))
            .unwrap();
    }
    with_metrics(&bench, &["psnr", "depth-abs-rel", "depth-delta"]);
    let result = bench.score().unwrap();
    assert!(
        result.unavailable[0]
            .reason
            .starts_with("no depth was predicted")
    );
    // 2.2 m in place of 2 m, and one frame without depth.
    fs::create_dir(bench.at("novel/depth")).unwrap();
    npy::write_f32(
        &bench.at("novel/depth/000004.npy"),
        &[HEIGHT, WIDTH],
        &[2.2; WIDTH * HEIGHT],
    )
    .unwrap();
    let result = bench.score().unwrap();
    let abs_rel = result.novel_views["depth-abs-rel"];
    assert!((abs_rel.mean - 0.1).abs() < 1e-6, "{}", abs_rel.mean);
    assert_eq!(result.novel_views["depth-delta"].mean, 1.0);
    assert_eq!(result.failures.len(), 1);
    assert_eq!(result.failures[0].reason, "depth/000009.npy is missing");
    npy::write_f32(&bench.at("novel/depth/000009.npy"), &[2, 3], &[1.0; 6]).unwrap();
    let reason = &bench.score().unwrap().failures[0].reason;
    assert_eq!(
        reason,
        "depth/000009.npy is of shape [2, 3], expected [16, 32]"
    );
}

#[test]
fn true_distances_may_be_an_array_of_floats() {
    let mut deep = scene(10, &[]);
    for (number, frame) in deep.frames.iter_mut().enumerate() {
        frame.depth = Some(DepthImage {
            file: format!("depth/{number}.npy"),
            unit: 0.5,
        });
    }
    let bench = Bench::of(&deep);
    // 2 m, and nothing is known of the sky above.
    let mut truth = [4.0; WIDTH * HEIGHT];
    truth[..WIDTH].fill(0.0);
    fs::create_dir(bench.at("scene/depth")).unwrap();
    let truth_of = |number: usize| bench.at(&format!("scene/depth/{number}.npy"));
    for number in 0..10 {
        npy::write_f32(&truth_of(number), &[HEIGHT, WIDTH], &truth).unwrap();
    }
    let predicted = [2.2; WIDTH * HEIGHT];
    fs::create_dir(bench.at("novel/depth")).unwrap();
    for name in ["000004", "000009"] {
        let file = bench.at(&format!("novel/depth/{name}.npy"));
        npy::write_f32(&file, &[HEIGHT, WIDTH], &predicted).unwrap();
    }
    with_metrics(&bench, &["psnr", "depth-abs-rel"]);
    let abs_rel = bench.score().unwrap().novel_views["depth-abs-rel"];
    assert!((abs_rel.mean - 0.1).abs() < 1e-6, "{}", abs_rel.mean);
    npy::write_f32(&truth_of(9), &[2, 3], &[1.0; 6]).unwrap();
    assert!(bench.refusal().contains("is 3x2 pixels, scene"));
}

/// Metrics of the whole sphere have no value for a pinhole, with a reason; all others have one.
#[test]
fn spherical_metrics_are_unavailable_for_a_pinhole() {
    let mut scene = scene(12, &[]);
    let erp = Bench::of(&scene).score().unwrap();
    scene.camera =
        PinholeCamera::with_horizontal_field_of_view(WIDTH as u32, HEIGHT as u32, 1.0).into();
    let mut protocol = omnilife_bench::protocols::protocol("per-scene").unwrap();
    let plain: Vec<&str> = METRICS
        .iter()
        .filter(|metric| needs_images(metric) && metric.id != "cube-ssim")
        .map(|metric| metric.id)
        .collect();
    protocol.metrics = plain.iter().map(|&id| id.to_owned()).collect();
    let bench = Bench::of(&scene);
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    let pinhole = bench.score().unwrap();
    let unavailable = pinhole.unavailable.iter();
    let unavailable: BTreeSet<&str> = unavailable
        .inspect(|one| assert!(one.reason.contains("pinhole"), "{}", one.reason))
        .map(|one| one.metric.as_str())
        .collect();
    assert_eq!(unavailable, ["cube-psnr", "ws-psnr", "ws-ssim"].into());
    assert_eq!(pinhole.novel_views.len() + 3, plain.len());
    assert_ne!(pinhole.scene_sha256, erp.scene_sha256);
}

#[test]
fn ground_truth_is_brought_to_the_protocols_width_by_area() {
    let mut bench = Bench::new();
    let mut protocol = omnilife_bench::protocols::protocol("per-scene").unwrap();
    protocol.largest_width = Some(12);
    let plain: Vec<&Metric> = METRICS.iter().filter(|m| needs_images(m)).collect();
    protocol.metrics = plain.iter().map(|metric| metric.id.to_owned()).collect();
    let scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    fs::create_dir(bench.at("small")).unwrap();
    for frame in [4, 9] {
        let file = bench.at("small").join(format!("{frame:06}.png"));
        image(frame, 2)
            .resized_by_area(12, 6)
            .write_png(&file)
            .unwrap();
    }
    bench.request.predictions = Predictions::Folders {
        input_views: None,
        novel_views: Some(bench.at("small")),
    };
    let result = bench.score().unwrap();
    assert_eq!(result.scored_size, [12, 6]);
    let resized = |error| image(4, error).resized_by_area(12, 6).to_rgb8();
    let pair = ViewPair::new(12, 6, resized(2), resized(0)).unwrap();
    // Images of 12x6 pixels are too small for four of them.
    let undefined: Vec<&str> = result
        .unavailable
        .iter()
        .map(|u| u.metric.as_str())
        .collect();
    assert_eq!(
        undefined,
        [
            "ssim-skimage",
            "ssim-skimage-uniform",
            "ssim-4dgf",
            "cube-ssim"
        ]
    );
    assert_eq!(result.novel_views.len() + undefined.len(), plain.len());
    let table = FrameScores::read(&bench.at("out/frames.csv")).unwrap();
    for metric in plain {
        let column = table.metrics.iter().position(|id| id == metric.id).unwrap();
        assert_eq!(
            table.rows[0].scores[column],
            (metric.function)(&Sample::new(&pair)).ok(),
            "{}",
            metric.id
        );
    }
    // Nothing is enlarged: a smaller scene is scored at its own size.
    protocol.largest_width = Some(64);
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    assert_eq!(
        split.protocol.scored_size(&scene.camera),
        Ok([WIDTH as u32, HEIGHT as u32])
    );
}

/// Predictions of context frames exist, and are not read.
#[test]
fn context_frames_are_never_scored() {
    let scene = scene(20, &[]);
    let mut bench = Bench::of(&scene);
    let protocol = omnilife_bench::protocols::protocol("sparse-interpolation").unwrap();
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    for frame in 0..20 {
        let file = bench.at("novel").join(format!("{frame:06}.png"));
        image(frame, 2).write_png(&file).unwrap();
    }
    let result = bench.score().unwrap();
    assert!(result.input_views.is_empty());
    assert_eq!(result.novel_views["psnr"].views, 16);
    // The four context frames among the novel views are strays; the input folder is not opened.
    assert_eq!(
        result.warnings,
        ["the predictions hold 4 images beyond the scored views"]
    );
    bench.request.predictions = Predictions::Folders {
        input_views: Some(bench.at("input")),
        novel_views: None,
    };
    assert!(bench.refusal().starts_with("nothing to score"));
}

#[test]
fn input_views_alone_are_scored_where_the_protocol_says_so() {
    let bench = Bench::of(&scene(10, &[]));
    let scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let protocol = omnilife_bench::protocols::protocol("input-view").unwrap();
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    for frame in [4, 9] {
        let file = bench.at("input").join(format!("{frame:06}.png"));
        image(frame, 1).write_png(&file).unwrap();
    }
    let result = bench.score().unwrap();
    assert!(result.novel_views.is_empty() && result.failures.is_empty());
    assert_eq!(result.input_views["psnr"].views, 10);
}
