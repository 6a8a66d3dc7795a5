//! Pixels that no score counts: predictions there do not change any metric.

use omnilife_bench::{DepthPair, METRICS, Metric, Need, Sample, Undefined, ViewPair, lpips::Lpips};
use omnilife_schemas::rgb::Mask;

const WIDTH: usize = 96;
const HEIGHT: usize = 48;

/// Bytes without a pattern.
fn noise(len: usize, seed: u32) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    (0..len).map(|_| next()).collect()
}

fn mask(is_marked: impl Fn(usize, usize) -> bool) -> Mask {
    let pixels = (0..WIDTH * HEIGHT).map(|at| (at % WIDTH, at / WIDTH));
    Mask {
        width: WIDTH,
        height: HEIGHT,
        data: pixels
            .map(|(x, y)| 255 * u8::from(is_marked(x, y)))
            .collect(),
    }
}

/// The lowest rows (a tripod) and a part that goes across the seam.
fn ignored() -> Mask {
    mask(|x, y| y >= 40 || (y > 10 && y < 30 && !(20..80).contains(&x)))
}

/// All data of a view with the prediction `prediction`, and predicted distances of `distance` under the mask.
struct KnownView {
    pair: ViewPair,
    before: ViewPair,
    moving: Mask,
    human: Mask,
    depth: DepthPair,
}

impl KnownView {
    fn new(mask: Option<&Mask>, under: [u8; 2]) -> Self {
        let truth = noise(3 * WIDTH * HEIGHT, 1);
        let pair = |seed: u32, byte: u8| {
            let mut prediction = noise(3 * WIDTH * HEIGHT, seed);
            let marked = ignored().data;
            for (pixel, marked) in prediction.as_chunks_mut::<3>().0.iter_mut().zip(marked) {
                if marked != 0 {
                    *pixel = [byte; 3];
                }
            }
            let pair = ViewPair::new(WIDTH, HEIGHT, prediction, truth.clone()).unwrap();
            match mask {
                Some(mask) => pair.ignoring(mask).unwrap(),
                None => pair,
            }
        };
        let distances = ignored().data.into_iter();
        let distances = distances.map(|marked| f32::from(if marked == 0 { 3 } else { under[0] }));
        Self {
            pair: pair(2, under[0]),
            before: pair(3, under[1]),
            moving: mask_of_a_diagonal(),
            human: self::mask(|x, y| (12..60).contains(&x) && (5..46).contains(&y)),
            depth: DepthPair {
                prediction: distances.collect(),
                truth: vec![4.0; WIDTH * HEIGHT],
            },
        }
    }

    fn sample(&self) -> Sample<'_> {
        let mut sample = Sample::new(&self.pair);
        sample.previous = Some(&self.before);
        sample.dynamic = Some(&self.moving);
        sample.classes = [("human", &self.human), ("vehicle", &self.moving)].into();
        sample.objects = [("a", &self.human)].into();
        sample.depth = Some(&self.depth);
        sample
    }
}

fn mask_of_a_diagonal() -> Mask {
    mask(|x, y| (x + 2 * y) % 7 < 3)
}

fn value(metric: &Metric, known: &KnownView) -> Result<f64, Undefined> {
    (metric.function)(&known.sample())
}

fn metric(id: &str) -> &'static Metric {
    METRICS.iter().find(|metric| metric.id == id).unwrap()
}

/// All whose networks are here.
fn computable() -> impl Iterator<Item = &'static Metric> {
    METRICS.iter().filter(|metric| {
        let is_here = metric.needs.iter().all(|need| match need {
            Need::Network(backbone) => Lpips::published(*backbone).is_ok(),
            _ => true,
        });
        if !is_here {
            omnilife_schemas::testing::skip(format_args!(
                "the weights of {} are missing",
                metric.id
            ));
        }
        is_here
    })
}

#[test]
fn what_is_predicted_where_nothing_counts_changes_no_score() {
    let ignored = ignored();
    let black = KnownView::new(Some(&ignored), [0, 0]);
    let grey = KnownView::new(Some(&ignored), [4, 90]);
    let (all_black, all_grey) = (KnownView::new(None, [0, 0]), KnownView::new(None, [4, 90]));
    for metric in computable() {
        let found = value(metric, &black).unwrap();
        assert_eq!(found, value(metric, &grey).unwrap(), "{}", metric.id);
        // The test means something: without the mask it does change them.
        let is_of_truth =
            metric.id == "temporal-lpips-truth" || metric.id.starts_with("ssim-object");
        assert!(
            is_of_truth || value(metric, &all_black) != value(metric, &all_grey),
            "{}",
            metric.id
        );
    }
}

#[test]
fn means_are_over_the_pixels_that_count() {
    let ignored = ignored();
    let known = KnownView::new(Some(&ignored), [0, 0]);
    let plain = KnownView::new(None, [0, 0]);
    let (mut sum, mut values) = (0.0, 0.0);
    let (mut weighted, mut weights) = (0.0, 0.0);
    let bytes = plain.pair.prediction().iter().zip(plain.pair.truth());
    for (at, (&predicted, &truth)) in bytes.enumerate() {
        if ignored.data[at / 3] != 0 {
            continue;
        }
        let error = (f64::from(predicted) - f64::from(truth)) / 255.0;
        let row = (at / 3 / WIDTH) as f64;
        let latitude = (0.5 - (row + 0.5) / HEIGHT as f64) * std::f64::consts::PI;
        sum += error * error;
        values += 1.0;
        weighted += latitude.cos() * error * error;
        weights += latitude.cos();
    }
    let psnr = -10.0 * (sum / values).log10();
    assert!((value(metric("psnr"), &known).unwrap() - psnr).abs() < 1e-9);
    let ws_psnr = -10.0 * (weighted / weights).log10();
    assert!((value(metric("ws-psnr"), &known).unwrap() - ws_psnr).abs() < 1e-9);
    // On the same images, static content is scored where nothing is ignored either.
    let mut composited = KnownView::new(None, [0, 0]);
    let [prediction, truth] = [known.pair.prediction(), known.pair.truth()].map(<[u8]>::to_vec);
    composited.pair = ViewPair::new(WIDTH, HEIGHT, prediction, truth).unwrap();
    composited.moving = ignored;
    let expected = value(metric("ssim-static"), &composited).unwrap();
    assert!((value(metric("ssim"), &known).unwrap() - expected).abs() < 1e-12);
}

/// A corner of its box that counts is not the object.
#[test]
fn an_object_that_is_ignored_has_no_score() {
    let disc = mask(|x, y| (x as f64 - 48.0).hypot(y as f64 - 24.0) < 12.0);
    let pair = KnownView::new(Some(&disc), [0, 0]).pair;
    let mut sample = Sample::new(&pair);
    sample.objects = [("a", &disc)].into();
    for metric in METRICS
        .iter()
        .filter(|metric| metric.needs.contains(&Need::ObjectMasks))
    {
        assert!((metric.function)(&sample).is_err(), "{}", metric.id);
    }
}

#[test]
fn a_mask_that_marks_nothing_changes_no_score() {
    let empty = mask(|_, _| false);
    let (with, without) = (
        KnownView::new(Some(&empty), [9, 9]),
        KnownView::new(None, [9, 9]),
    );
    for metric in computable() {
        let (with, without) = (
            value(metric, &with).unwrap(),
            value(metric, &without).unwrap(),
        );
        assert!(
            (with - without).abs() < 1e-12,
            "{}: {with} {without}",
            metric.id
        );
    }
}

#[test]
fn a_mask_of_everything_or_of_another_size_is_refused() {
    let pair = || {
        ViewPair::new(
            WIDTH,
            HEIGHT,
            noise(3 * WIDTH * HEIGHT, 1),
            noise(3 * WIDTH * HEIGHT, 2),
        )
    };
    assert!(pair().unwrap().ignoring(&mask(|_, _| true)).is_none());
    let smaller = mask(|_, _| false).resized_to_any(WIDTH / 2, HEIGHT / 2);
    assert!(pair().unwrap().ignoring(&smaller).is_none());
}

#[test]
fn a_smaller_mask_marks_every_pixel_that_a_marked_one_touches() {
    let one = mask(|x, y| (x, y) == (6, 3));
    for (width, height, expected) in [
        (48, 24, vec![(3, 1)]),
        (64, 32, vec![(4, 2)]),
        (36, 48, vec![(2, 3)]),
    ] {
        let resized = one.resized_to_any(width, height);
        let marked = (0..width * height).filter(|&at| resized.data[at] != 0);
        let marked: Vec<_> = marked.map(|at| (at % width, at / width)).collect();
        assert_eq!(marked, expected, "{width}x{height}");
    }
}
