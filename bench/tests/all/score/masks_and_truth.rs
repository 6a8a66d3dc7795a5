//! Scores with masks in various encodings, and with ground truth that is empty or shown differently by programs.

use std::path::Path;

use image::{Rgba, RgbaImage};
use omnilife_bench::{notes_on_split, validate};

use super::*;

const FOLDER: &str = "masks";

/// A scene of which every frame has the mask `masks/moving.png`, or `masks/ignored.png` of pixels outside of it. Its
/// novel views are off by 8 bytes in their left half and by 2 in the right one.
fn bench(is_ignored: bool) -> Bench {
    let mut scene = scene(10, &[]);
    for frame in &mut scene.frames {
        if is_ignored {
            frame.ignore_mask = Some(format!("{FOLDER}/ignored.png"));
        } else {
            frame.mask = Some(format!("{FOLDER}/moving.png"));
        }
    }
    let bench = Bench::of(&scene);
    fs::create_dir(bench.at("scene").join(FOLDER)).unwrap();
    for frame in [4, 9] {
        let (left, mut both) = (image(frame, 8), image(frame, 2));
        let pixels = both.data.chunks_mut(3).zip(left.data.chunks(3));
        for (at, (pixel, left)) in pixels.enumerate() {
            if at % WIDTH < WIDTH / 2 {
                pixel.copy_from_slice(left);
            }
        }
        let file = bench.at(&format!("novel/{frame:06}.png"));
        both.write_png(&file).unwrap();
    }
    bench
}

/// Marks the first columns with a value.
fn first_columns(columns: usize, value: u8) -> Mask {
    let is_marked = |pixel: usize| pixel % WIDTH < columns;
    Mask {
        width: WIDTH,
        height: HEIGHT,
        data: (0..WIDTH * HEIGHT)
            .map(|pixel| value * u8::from(is_marked(pixel)))
            .collect(),
    }
}

/// Marks the left half with a value of four channels, and the rest with another.
fn write_rgba(marked: [u8; 4], other: [u8; 4], file: &Path) {
    let image = RgbaImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, _| {
        Rgba(if (x as usize) < WIDTH / 2 {
            marked
        } else {
            other
        })
    });
    image.save(file).unwrap();
}

fn count(lines: &[String], word: &str) -> usize {
    lines.iter().filter(|line| line.contains(word)).count()
}

/// Notes of validating.
fn validated(bench: &Bench) -> Vec<String> {
    let recorder = Recorder::default();
    let request = &bench.request;
    validate(
        &request.scene,
        &request.split,
        &request.predictions,
        &recorder,
    )
    .unwrap();
    recorder.notes.into_inner().unwrap()
}

/// Every encoding of a mask gives the scores of white on black, with a note on assumptions.
#[test]
fn scores_do_not_depend_on_the_encoding_of_masks() {
    let bench = bench(false);
    with_metrics(&bench, &["psnr", "psnr-dynamic", "psnr-static"]);
    let file = bench.at("scene").join(FOLDER).join("moving.png");
    let half = WIDTH / 2;
    let (black, clear) = ([0, 0, 0, 255], [9, 9, 9, 0]);
    let encodings: [(&str, &dyn Fn(), usize); 6] = [
        (
            "white",
            &|| first_columns(half, 255).write_png(&file).unwrap(),
            0,
        ),
        (
            "ones",
            &|| first_columns(half, 1).write_png(&file).unwrap(),
            1,
        ),
        (
            "labels",
            &|| first_columns(half, 11).write_png(&file).unwrap(),
            1,
        ),
        ("blue", &|| write_rgba([0, 0, 60, 255], black, &file), 1),
        ("alpha", &|| write_rgba([9, 9, 9, 255], clear, &file), 1),
        ("white, opaque", &|| write_rgba([255; 4], black, &file), 0),
    ];
    for (name, write, told) in encodings {
        write();
        let result = bench.score().unwrap();
        let mean = |metric: &str| result.novel_views[metric].mean;
        assert!(
            (mean("psnr-dynamic") - flat_psnr(8.0)).abs() < 1e-9,
            "{name}"
        );
        assert!(
            (mean("psnr-static") - flat_psnr(2.0)).abs() < 1e-9,
            "{name}"
        );
        assert_eq!(count(&result.warnings, "masks/moving.png"), told, "{name}");
        assert_eq!(
            count(&validated(&bench), "masks/moving.png"),
            told,
            "{name}"
        );
    }
    // Masks of moving content are not read unless a metric needs them.
    let without = self::bench(false);
    let file = without.at("scene").join(FOLDER).join("moving.png");
    first_columns(half, 1).write_png(&file).unwrap();
    assert_eq!(
        count(&without.score().unwrap().warnings, "masks/moving.png"),
        0
    );
}

/// Views with ignored pixels are those whose masks mark some: by labels too, and not by an empty mask.
#[test]
fn views_with_ignored_pixels_are_those_whose_masks_mark_some() {
    let bench = bench(true);
    let mut scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let folder = bench.at("scene").join(FOLDER);
    for frame in &mut scene.frames {
        frame.ignore_mask = None;
    }
    scene.frames[4].ignore_mask = Some(format!("{FOLDER}/left.png"));
    scene.frames[9].ignore_mask = Some(format!("{FOLDER}/nothing.png"));
    store::write_record(&bench.request.scene, &scene).unwrap();
    first_columns(WIDTH / 2, 1)
        .write_png(&folder.join("left.png"))
        .unwrap();
    first_columns(0, 0)
        .write_png(&folder.join("nothing.png"))
        .unwrap();
    let result = bench.score().unwrap();
    let of_all_pixels = -10.0 * (f64::midpoint(8.0 * 8.0, 2.0 * 2.0) / 255.0_f64.powi(2)).log10();
    let expected = f64::midpoint(flat_psnr(2.0), of_all_pixels);
    assert!((result.novel_views["psnr"].mean - expected).abs() < 1e-9);
    assert_eq!(count(&result.warnings, "1 of 10 scored views"), 1);
    assert_eq!(count(&result.warnings, "masks/left.png"), 1);
    assert_eq!(count(&result.warnings, "1 of 2 masks"), 1);
}

#[test]
fn ignore_masks_of_most_of_the_sphere_are_told() {
    let bench = bench(true);
    let file = bench.at("scene").join(FOLDER).join("ignored.png");
    for (columns, told) in [(WIDTH / 4, 0), (WIDTH / 2, 0), (WIDTH * 3 / 4, 1)] {
        first_columns(columns, 255).write_png(&file).unwrap();
        let warnings = bench.score().unwrap().warnings;
        assert_eq!(count(&warnings, "inverted"), told, "{columns}");
        assert_eq!(count(&validated(&bench), "inverted"), told, "{columns}");
    }
}

#[test]
fn transparent_ground_truth_is_refused() {
    let bench = Bench::new();
    let file = bench.at("scene/frames/000004.png");
    let opaque = image::open(&file).unwrap().to_rgba8();
    // An alpha channel that hides nothing is not a reason.
    opaque.save(&file).unwrap();
    let plain = bench.score().unwrap();
    assert!((plain.novel_views["psnr"].mean - flat_psnr(2.0)).abs() < 1e-9);
    let mut hidden = opaque;
    hidden.put_pixel(7, 11, Rgba([0, 255, 0, 254]));
    hidden.save(&file).unwrap();
    assert!(bench.refusal().contains("000004.png"));
    let lines = notes_on_split(&bench.request.scene, &bench.split).unwrap();
    assert_eq!(count(&lines, "000004.png"), 1);
}

#[test]
fn ground_truth_that_shows_nothing_is_told() {
    let bench = Bench::new();
    let of_split = || notes_on_split(&bench.request.scene, &bench.split).unwrap();
    assert_eq!(of_split(), [""; 0]);
    let frame = |number: u32| bench.at(&format!("scene/frames/{number:06}.png"));
    RgbImage::black(WIDTH, HEIGHT).write_png(&frame(3)).unwrap();
    let grey = vec![77; 3 * WIDTH * HEIGHT];
    RgbImage::from_rgb8(WIDTH, HEIGHT, &grey)
        .write_png(&frame(9))
        .unwrap();
    let warnings = bench.score().unwrap().warnings;
    for lines in [of_split(), validated(&bench), warnings] {
        assert_eq!(count(&lines, "frames 3, 9"), 1, "{lines:?}");
    }
}

/// Any method that shows what is given scores high there.
#[test]
fn novel_frames_that_repeat_given_ones_are_told_by_the_split() {
    let bench = Bench::new();
    let of_split = || notes_on_split(&bench.request.scene, &bench.split).unwrap();
    let frame = |number: u32| bench.at(&format!("scene/frames/{number:06}.png"));
    fs::copy(frame(3), frame(4)).unwrap();
    let lines = of_split();
    assert_eq!(
        count(&lines, "the same image as a given frame"),
        1,
        "{lines:?}"
    );
}

/// A region can be the ground truth where the whole view is not.
#[test]
fn equal_regions_are_told() {
    let bench = bench(false);
    with_metrics(&bench, &["psnr", "psnr-dynamic", "psnr-static"]);
    let file = bench.at("scene").join(FOLDER).join("moving.png");
    first_columns(WIDTH / 2, 255).write_png(&file).unwrap();
    let scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let truth = image::open(bench.at("scene").join(&scene.frames[4].image)).unwrap();
    let prediction = bench.at("novel/000004.png");
    let mut half = image::open(&prediction).unwrap().to_rgb8();
    for (x, y, pixel) in truth.to_rgb8().enumerate_pixels() {
        if x as usize >= WIDTH / 2 {
            half.put_pixel(x, y, *pixel);
        }
    }
    half.save(&prediction).unwrap();
    let warnings = bench.score().unwrap().warnings;
    assert_eq!(count(&warnings, "psnr-static of 1 of"), 1, "{warnings:?}");
    assert_eq!(count(&warnings, "psnr-dynamic of"), 0, "{warnings:?}");
}
