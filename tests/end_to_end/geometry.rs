//! Geometry of rendered views: upright, not mirrored, not shifted, and whole at the seam and the poles.

use std::{ops::Range, sync::LazyLock};

use image::RgbImage;
use tempfile::TempDir;

use crate::support::{METHOD, NOVEL_VIEWS, SEQUENCE, read_image, run, sample, scratch};

const WIDTH: u32 = 256;
const HEIGHT: u32 = 128;
const ITERATIONS: &str = "150";

/// Predicted novel view with its ground truth.
struct View {
    predicted: RgbImage,
    truth: RgbImage,
    /// Dynamic mask, white where something moves.
    moving: RgbImage,
}

static VIEWS: LazyLock<Vec<View>> = LazyLock::new(|| {
    let out: TempDir = scratch();
    let settings = [
        "--max-frames",
        "10",
        "--width",
        "256",
        "--iterations",
        ITERATIONS,
    ];
    run(&sample("street.mp4"), out.path(), &settings).succeeded();
    NOVEL_VIEWS
        .iter()
        .map(|frame| {
            let file = |folder: String| read_image(&out.path().join(folder));
            View {
                predicted: file(format!("{METHOD}/run/predictions/novel/{frame:06}.png")),
                truth: file(format!("{SEQUENCE}/frames/{frame:06}.png")),
                moving: file(format!("{SEQUENCE}/masks/{frame:06}.png")),
            }
        })
        .collect()
});

/// Returns the PSNR in dB of a prediction whose pixel (x, y) is taken from `from(x, y)`.
fn psnr(view: &View, from: impl Fn(u32, u32) -> (u32, u32)) -> f64 {
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    psnr_of(view, pixels, from)
}

/// Returns the PSNR in dB of the static region in some columns, which are counted around the sphere.
fn static_psnr(view: &View, columns: Range<u32>) -> f64 {
    let pixels = columns
        .flat_map(|x| (0..HEIGHT).map(move |y| (x % WIDTH, y)))
        .filter(|&(x, y)| view.moving.get_pixel(x, y)[0] == 0);
    psnr_of(view, pixels, |x, y| (x, y))
}

fn psnr_of(
    view: &View,
    pixels: impl Iterator<Item = (u32, u32)>,
    from: impl Fn(u32, u32) -> (u32, u32),
) -> f64 {
    let (mut sum, mut values) = (0.0, 0.0);
    for (x, y) in pixels {
        let (from_x, from_y) = from(x, y);
        let truth = view.truth.get_pixel(x, y);
        let predicted = view.predicted.get_pixel(from_x, from_y);
        for channel in 0..3 {
            let difference = f64::from(truth[channel]) - f64::from(predicted[channel]);
            sum += (difference / 255.0).powi(2);
            values += 1.0;
        }
    }
    -10.0 * (sum / values).log10()
}

/// Returns the mean absolute difference of two columns, in 8-bit steps.
fn column_difference(image: &RgbImage, left: u32, right: u32) -> f64 {
    let sum: u32 = (0..HEIGHT)
        .flat_map(|y| {
            let (a, b) = (image.get_pixel(left, y), image.get_pixel(right, y));
            (0..3).map(|channel| u32::from(a[channel].abs_diff(b[channel])))
        })
        .sum();
    f64::from(sum) / f64::from(3 * HEIGHT)
}

fn brightness(image: &RgbImage, x: u32, y: u32) -> u32 {
    image.get_pixel(x, y).0.iter().copied().map(u32::from).sum()
}

#[test]
fn views_are_upright_not_mirrored_and_not_shifted() {
    for view in VIEWS.iter() {
        let straight = psnr(view, |x, y| (x, y));
        let shifted = |columns: u32| psnr(view, |x, y| ((x + columns) % WIDTH, y));
        let raised = psnr(view, |x, y| (x, y.saturating_sub(1)));
        let lowered = psnr(view, |x, y| (x, (y + 1).min(HEIGHT - 1)));
        let mirrored = psnr(view, |x, y| (WIDTH - 1 - x, y));
        let upside_down = psnr(view, |x, y| (x, HEIGHT - 1 - y));
        let [right, left] = [1, WIDTH - 1].map(shifted);
        let [quarter, half] = [WIDTH / 4, WIDTH / 2].map(shifted);
        println!(
            "{straight:.2} dB; mirrored {mirrored:.2}, upside down {upside_down:.2}, a quarter \
             round {quarter:.2}, half round {half:.2}; a pixel off: {left:.2} {right:.2} \
             {raised:.2} {lowered:.2}"
        );
        assert!(straight > 18.0);
        for wrong in [mirrored, upside_down, quarter, half] {
            assert!(straight > wrong + 5.0);
        }
        for near in [left, right, raised, lowered] {
            assert!(straight > near + 0.5);
        }
    }
}

#[test]
fn the_seam_is_a_place_like_any_other() {
    for view in VIEWS.iter() {
        let image = &view.predicted;
        let seam = column_difference(image, WIDTH - 1, 0);
        let inside: f64 = (0..WIDTH - 1)
            .map(|x| column_difference(image, x, x + 1))
            .sum::<f64>()
            / f64::from(WIDTH - 1);
        let of_truth = column_difference(&view.truth, WIDTH - 1, 0);
        let at_seam = static_psnr(view, WIDTH - 4..WIDTH + 4);
        let all = static_psnr(view, 0..WIDTH);
        println!(
            "seam {seam:.2}, inside {inside:.2}; ground truth's seam {of_truth:.2}; {at_seam:.2} dB \
             at the seam, {all:.2} dB in all"
        );
        assert!(seam <= 1.5 * inside);
        assert!(at_seam > all - 3.0);
    }
}

#[test]
fn the_poles_have_no_holes() {
    for view in VIEWS.iter() {
        let polar = (0..4).chain(HEIGHT - 4..HEIGHT);
        let mut bright = 0;
        for (x, y) in polar.flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let (truth, predicted) = (
                brightness(&view.truth, x, y),
                brightness(&view.predicted, x, y),
            );
            if truth >= 3 * 64 {
                bright += 1;
                assert!(predicted > 3 * 16, "({x}, {y}): {predicted} for {truth}");
            }
        }
        println!("{bright} bright pixels of {} at the poles", 8 * WIDTH);
        assert!(bright > 2 * WIDTH, "the sample's poles have become dark");
    }
}
