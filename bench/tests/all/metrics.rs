//! Every metric against golden values of other implementations and against plain definitions.

use std::{
    collections::{BTreeMap, BTreeSet},
    f64::consts::PI,
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::{
    DepthPair, METRICS, Metric, Need, Sample, Undefined, ViewPair,
    lpips::{Backbone, InputRange, Lpips},
};
use omnilife_schemas::{RgbImage, records::Direction, rgb::Mask};
use proptest::prelude::*;
use serde::Deserialize;

/// Written by `scripts/golden/metrics.py`.
#[derive(Deserialize)]
struct Goldens {
    pairs: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/metrics")
}

fn goldens() -> Goldens {
    serde_json::from_slice(&fs::read(folder().join("goldens.json")).unwrap()).unwrap()
}

fn stored_pair(name: &str) -> ViewPair {
    let read = |kind: &str| RgbImage::read(&folder().join(format!("{name}-{kind}.png"))).unwrap();
    let (prediction, truth) = (read("prediction"), read("truth"));
    let (width, height) = (truth.width, truth.height);
    ViewPair::new(width, height, prediction.to_rgb8(), truth.to_rgb8()).unwrap()
}

fn metric(id: &str) -> &'static Metric {
    METRICS.iter().find(|metric| metric.id == id).unwrap()
}

/// The value of a metric that is defined for every pair.
fn value(id: &str, pair: &ViewPair) -> f64 {
    (metric(id).function)(&Sample::new(pair)).unwrap()
}

/// The metrics that need nothing but a pair and are defined for images of any size.
fn plain() -> impl Iterator<Item = &'static Metric> {
    let sized = [
        "ssim-skimage",
        "ssim-skimage-uniform",
        "ssim-4dgf",
        "cube-ssim",
    ];
    METRICS.iter().filter(move |metric| {
        metric.needs.iter().all(|need| *need == Need::Sphere) && !sized.contains(&metric.id)
    })
}

/// Returns true if the weights of a metric's networks exist; prints a reason otherwise.
fn has_weights(metric: &Metric) -> bool {
    let found = metric.needs.iter().all(|need| match need {
        Need::Network(backbone) => Lpips::published(*backbone).is_ok(),
        _ => true,
    });
    if !found {
        omnilife_schemas::testing::skip(format_args!("the weights of {} are missing", metric.id));
    }
    found
}

/// Tolerance of a golden value: 1e-6 dB, 1e-4 for results of a network in f32, 1e-5 for other scores.
fn tolerance(metric: &Metric) -> f64 {
    if metric.unit == "dB" {
        1e-6
    } else if metric.id.contains("lpips") {
        1e-4
    } else {
        1e-5
    }
}

/// Masks, depth and the view before, by the rules of `evidence` in `scripts/golden/metrics.py`.
struct Evidence {
    pair: ViewPair,
    before: ViewPair,
    masks: [Mask; 3],
    depth: DepthPair,
}

impl Evidence {
    fn of(pair: ViewPair) -> Self {
        let [width, height] = pair.size();
        let mask = |is_inside: fn(usize, usize) -> bool| Mask {
            width,
            height,
            data: (0..width * height)
                .map(|at| 255 * u8::from(is_inside(at % width, at / width)))
                .collect(),
        };
        let mirrored = |bytes: &[u8]| {
            let rows = bytes.chunks_exact(3 * width);
            rows.flat_map(|row| row.chunks_exact(3).rev().flatten())
                .copied()
                .collect()
        };
        let red = |bytes: &[u8]| {
            let pixels = bytes.chunks_exact(3);
            pixels.map(|pixel| f32::from(pixel[0]) / 16.0).collect()
        };
        let (prediction, truth) = (pair.prediction(), pair.truth());
        Self {
            before: ViewPair::new(width, height, mirrored(prediction), mirrored(truth)).unwrap(),
            masks: [
                mask(|x, y| (x + 2 * y) % 7 < 3),
                mask(|x, y| (x + y).is_multiple_of(5)),
                mask(|x, y| x > 40 && y > 10),
            ],
            depth: DepthPair {
                prediction: red(prediction),
                truth: red(truth),
            },
            pair,
        }
    }

    fn sample(&self) -> Sample<'_> {
        let mut sample = Sample::new(&self.pair);
        sample.previous = Some(&self.before);
        let [dynamic, human, vehicle] = &self.masks;
        sample.dynamic = Some(dynamic);
        sample.classes = [("human", human), ("vehicle", vehicle)].into();
        sample.objects = [("a", human), ("b", vehicle)].into();
        sample.depth = Some(&self.depth);
        sample
    }
}

/// Strips of rows and images by themselves change no bit of a distance.
#[test]
fn distances_of_kept_features_are_those_of_images() {
    // More rows than a strip of stages at full size has.
    let [width, height] = [72, 150];
    let bytes = |factor: usize| -> Vec<u8> {
        let values = (0..width * height * 3).map(|at| (at * factor + at / 7) % 251);
        values.map(|value| value as u8).collect()
    };
    let (left, right) = (bytes(31), bytes(37));
    for backbone in [Backbone::Alex, Backbone::Vgg] {
        let Ok(network) = Lpips::published(backbone) else {
            let name = backbone.weights();
            omnilife_schemas::testing::skip(format_args!("the weights of {name} are missing"));
            continue;
        };
        let range = InputRange::Signed;
        let size = [width, height];
        let expected = network.distance(size, [&left, &right], range).unwrap();
        let features = [&left, &right].map(|image| network.features(size, image, range).unwrap());
        let found = network.distance_of_features(features.each_ref());
        assert_eq!(
            found.to_bits(),
            expected.to_bits(),
            "{backbone:?}: {found} {expected}"
        );
    }
}

#[test]
fn ids_are_unique_and_documented() {
    let ids: BTreeSet<_> = METRICS.iter().map(|metric| metric.id).collect();
    assert_eq!(ids.len(), METRICS.len());
    for metric in METRICS {
        assert!(!metric.title.is_empty(), "{}", metric.id);
        assert!(
            metric.source.len() > 60,
            "{} needs its definition",
            metric.id
        );
        assert!(metric.range[0] < metric.range[1], "{}", metric.id);
    }
}

#[test]
fn every_metric_has_its_golden_values() {
    let goldens = goldens();
    assert!(goldens.pairs.len() >= 20);
    let mut compared: BTreeMap<&str, usize> = BTreeMap::new();
    for (name, expected) in &goldens.pairs {
        let evidence = Evidence::of(stored_pair(name));
        let sample = evidence.sample();
        for metric in METRICS {
            let golden = expected[metric.id];
            if !has_weights(metric) {
                continue;
            }
            let value = (metric.function)(&sample);
            match (value, golden) {
                (Ok(value), Some(golden)) => assert!(
                    (value - golden).abs() < tolerance(metric),
                    "{name}: {} is {value}, golden {golden}",
                    metric.id
                ),
                (Err(Undefined(_)), None) => continue,
                (value, golden) => panic!("{name}: {} is {value:?}, golden {golden:?}", metric.id),
            }
            *compared.entry(metric.id).or_default() += 1;
        }
    }
    for (metric, pairs) in compared {
        assert!(pairs >= 8, "{metric} is compared on {pairs} pairs alone");
    }
}

#[test]
fn identical_images_score_the_best_value() {
    let evidence = Evidence::of(stored_pair("identical-street"));
    for metric in METRICS.iter().filter(|metric| has_weights(metric)) {
        let best = match metric.direction {
            Some(Direction::HigherIsBetter) => metric.range[1],
            Some(Direction::LowerIsBetter) => metric.range[0],
            None => continue,
        };
        assert_eq!(
            (metric.function)(&evidence.sample()),
            Ok(best),
            "{}",
            metric.id
        );
    }
}

/// Missing data give neither 0 nor infinity.
#[test]
fn without_masks_depth_or_a_view_before_metrics_are_undefined() {
    let pair = stored_pair("compressed");
    let mut evidence = Evidence::of(pair.clone());
    for metric in METRICS.iter().filter(|metric| has_weights(metric)) {
        let alone = (metric.function)(&Sample::new(&pair));
        let needs_more = metric
            .needs
            .iter()
            .any(|need| !matches!(need, Need::Network(_) | Need::Sphere));
        assert_eq!(alone.is_err(), needs_more, "{}: {alone:?}", metric.id);
    }
    for mask in &mut evidence.masks {
        mask.data.fill(0);
    }
    evidence.depth.truth.fill(0.0);
    for id in [
        "psnr-dynamic",
        "ssim-dynamic",
        "psnr-human",
        "ssim-vehicle",
        "depth-abs-rel",
    ] {
        assert!((metric(id).function)(&evidence.sample()).is_err(), "{id}");
    }
    // Without moving content, static content is the whole image.
    let still = |id: &str| (metric(id).function)(&evidence.sample()).unwrap();
    assert!((still("psnr-static") - value("psnr", &pair)).abs() < 1e-12);
    assert!((still("ssim-static") - value("ssim", &pair)).abs() < 1e-12);
}

/// Distances that are missing or impossible count as 0: as wrong as seeing nothing at all.
#[test]
fn depth_that_is_not_finite_counts_as_none() {
    let pair = ViewPair::new(4, 1, vec![0; 12], vec![0; 12]).unwrap();
    let depth = DepthPair {
        prediction: vec![f32::NAN, f32::INFINITY, -2.0, 1.1],
        truth: vec![1.0, 2.0, 3.0, 1.0],
    };
    let mut sample = Sample::new(&pair);
    sample.depth = Some(&depth);
    let abs_rel = (metric("depth-abs-rel").function)(&sample).unwrap();
    assert!((abs_rel - 3.1 / 4.0).abs() < 1e-6, "{abs_rel}");
    assert_eq!((metric("depth-delta").function)(&sample), Ok(0.25));
}

#[test]
fn black_against_white_is_zero_decibels() {
    let pair = stored_pair("black-white");
    for id in ["psnr", "psnr-channels", "ws-psnr"] {
        let value = value(id, &pair);
        // Never -0, which tables would print with its sign; weights round in their last digit.
        assert!(value.is_sign_positive() && value < 1e-12, "{id}: {value}");
    }
}

#[test]
fn buffers_of_the_wrong_size_are_refused() {
    assert!(ViewPair::new(2, 1, vec![0; 6], vec![0; 6]).is_some());
    assert!(ViewPair::new(2, 1, vec![0; 5], vec![0; 6]).is_none());
    assert!(ViewPair::new(2, 1, vec![0; 6], vec![0; 7]).is_none());
    assert!(ViewPair::new(0, 1, Vec::new(), Vec::new()).is_none());
    assert!(ViewPair::new(usize::MAX, 2, vec![0; 6], vec![0; 6]).is_none());
}

/// The same errors weigh less near a pole in `ws-psnr` and the same everywhere in `psnr`.
#[test]
fn polar_errors_weigh_their_area() {
    let (width, height) = (32, 16);
    let wrong_row = |row: usize| {
        let mut prediction = vec![100; width * height * 3];
        prediction[row * width * 3..(row + 1) * width * 3].fill(140);
        ViewPair::new(width, height, prediction, vec![100; width * height * 3]).unwrap()
    };
    let (pole, equator) = (wrong_row(0), wrong_row(height / 2));
    assert_eq!(value("psnr", &pole), value("psnr", &equator));
    let angle = |row: f64| (row + 0.5 - 8.0) * PI / 16.0;
    let gain = 10.0 * (angle(8.0).cos() / angle(0.0).cos()).log10();
    let measured = value("ws-psnr", &pole) - value("ws-psnr", &equator);
    assert!((measured - gain).abs() < 1e-9, "{measured} {gain}");
}

fn pairs() -> impl Strategy<Value = ViewPair> {
    (1_usize..24, 1_usize..24).prop_flat_map(|(width, height)| {
        let image = || prop::collection::vec(any::<u8>(), width * height * 3);
        (image(), image()).prop_map(move |(prediction, truth)| {
            ViewPair::new(width, height, prediction, truth).unwrap()
        })
    })
}

/// The definition of 3DGS's SSIM: a two-dimensional window over every pixel, one loop per index.
fn direct_ssim(pair: &ViewPair) -> f64 {
    let (width, height) = (pair.width() as i64, pair.height() as i64);
    let gaussian = |d: i64| (-(d * d) as f64 / (2.0 * 1.5 * 1.5)).exp();
    let norm: f64 = (-5..=5)
        .flat_map(|dy| (-5..=5).map(move |dx| gaussian(dx) * gaussian(dy)))
        .sum();
    let at = |image: &[u8], x: i64, y: i64, channel: i64| {
        if (0..width).contains(&x) && (0..height).contains(&y) {
            f64::from(image[((y * width + x) * 3 + channel) as usize]) / 255.0
        } else {
            0.0
        }
    };
    let mut sum = 0.0;
    for channel in 0..3 {
        for y in 0..height {
            for x in 0..width {
                let [mut a, mut b, mut aa, mut bb, mut ab] = [0.0; 5];
                for dy in -5..=5 {
                    for dx in -5..=5 {
                        let weight = gaussian(dx) * gaussian(dy) / norm;
                        let p = at(pair.prediction(), x + dx, y + dy, channel);
                        let t = at(pair.truth(), x + dx, y + dy, channel);
                        a += weight * p;
                        b += weight * t;
                        aa += weight * p * p;
                        bb += weight * t * t;
                        ab += weight * p * t;
                    }
                }
                let (c1, c2) = (1e-4, 9e-4);
                sum += (2.0 * a * b + c1) * (2.0 * (ab - a * b) + c2)
                    / ((a * a + b * b + c1) * ((aa - a * a) + (bb - b * b) + c2));
            }
        }
    }
    sum / (width * height * 3) as f64
}

fn direct_mse(pair: &ViewPair, channels: &[usize], weight: impl Fn(usize) -> f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for row in 0..pair.height() {
        for column in 0..pair.width() {
            for channel in channels {
                let index = (row * pair.width() + column) * 3 + channel;
                let difference = f64::from(pair.prediction()[index]) / 255.0
                    - f64::from(pair.truth()[index]) / 255.0;
                sum += weight(row) * difference * difference;
                weights += weight(row);
            }
        }
    }
    sum / weights
}

fn direct_psnr(mse: f64) -> f64 {
    -10.0 * mse.max(1e-10).log10()
}

fn close(value: f64, expected: f64, tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert!(
        (value - expected).abs() < tolerance,
        "{value}, expected {expected}"
    );
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn metrics_follow_their_definitions(pair in pairs()) {
        let height = pair.height() as f64;
        let all = [0, 1, 2];
        close(value("ssim", &pair), direct_ssim(&pair), 1e-12)?;
        close(value("psnr", &pair), direct_psnr(direct_mse(&pair, &all, |_| 1.0)), 1e-9)?;
        let channels = all.map(|channel| direct_psnr(direct_mse(&pair, &[channel], |_| 1.0)));
        close(value("psnr-channels", &pair), channels.iter().sum::<f64>() / 3.0, 1e-9)?;
        let weight = |row: usize| ((row as f64 + 0.5) * PI / height).sin();
        close(value("ws-psnr", &pair), direct_psnr(direct_mse(&pair, &all, weight)), 1e-9)?;
    }

    #[test]
    fn metrics_are_symmetric_and_in_range(pair in pairs()) {
        let swapped = ViewPair::new(
            pair.width(),
            pair.height(),
            pair.truth().to_vec(),
            pair.prediction().to_vec(),
        )
        .unwrap();
        for metric in plain() {
            let value = value(metric.id, &pair);
            prop_assert!((metric.range[0]..=metric.range[1]).contains(&value));
            close(value, self::value(metric.id, &swapped), 1e-12)?;
        }
        prop_assert!(value("psnr-channels", &pair) >= value("psnr", &pair) - 1e-9);
    }

    #[test]
    fn a_larger_error_scores_worse(
        width in 1_usize..20, height in 1_usize..20, small in 1_u8..100, more in 1_u8..100
    ) {
        let flat = |byte: u8| vec![byte; width * height * 3];
        let pair = |byte| ViewPair::new(width, height, flat(byte), flat(20)).unwrap();
        let (near, far) = (pair(20 + small), pair(20 + small + more));
        for metric in plain() {
            let scores = [&near, &far].map(|pair| value(metric.id, pair));
            let direction = metric.direction.unwrap();
            prop_assert!(direction.prefers(scores[0], scores[1]), "{}", metric.id);
        }
    }
}

/// The score is the same number, bit for bit, for every number of threads.
#[test]
fn threads_do_not_change_a_score() {
    let evidence = Evidence::of(stored_pair("compressed"));
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            METRICS
                .iter()
                .map(|m| (m.function)(&evidence.sample()).map(f64::to_bits))
                .collect::<Vec<_>>()
        })
    };
    assert_eq!(with_threads(1), with_threads(5));
}

/// Real frames: the separable SSIM against the direct one on footage of this project.
#[test]
fn ssim_of_real_frames_follows_the_definition() {
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/street/rgb");
    let Ok(entries) = fs::read_dir(&street) else {
        omnilife_schemas::testing::skip(format_args!("{} is not there", street.display()));
        return;
    };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let bytes = |index: usize| {
        let image = RgbImage::read(&files[index]).unwrap();
        image.resized_by_area(128, 64).to_rgb8()
    };
    let pair = ViewPair::new(128, 64, bytes(4), bytes(9)).unwrap();
    assert!((value("ssim", &pair) - direct_ssim(&pair)).abs() < 1e-12);
}
