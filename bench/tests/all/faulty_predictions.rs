//! Faults in the files of predictions: each is a failure with its reason, and never repaired.

use std::fs;

use omnilife_schemas::{npy, records::ResultRecord};
use scenes::{HEIGHT, WIDTH};
use scoring::{Bench, image};

use crate::{scenes, scoring};

/// Returns the reasons of a result's failures, in its order.
fn reasons(result: &ResultRecord) -> Vec<&str> {
    let failures = result.failures.iter();
    failures.map(|failure| failure.reason.as_str()).collect()
}

#[test]
fn faults_of_predictions_are_rows_of_failures() {
    let bench = Bench::new();
    let file = |frame: u32| bench.at("input").join(format!("{frame:06}.png"));
    fs::remove_file(file(0)).unwrap();
    fs::write(file(1), b"").unwrap();
    let whole = fs::read(file(2)).unwrap();
    fs::write(file(2), &whole[..whole.len() / 2]).unwrap();
    image(3, 0)
        .resized_by_area(WIDTH / 2, HEIGHT / 2)
        .write_png(&file(3))
        .unwrap();
    image::GrayImage::new(WIDTH as u32, HEIGHT as u32)
        .save(file(5))
        .unwrap();
    let clear = image::RgbaImage::new(WIDTH as u32, HEIGHT as u32);
    clear.save(file(6)).unwrap();
    let jpeg = image::RgbImage::new(WIDTH as u32, HEIGHT as u32);
    jpeg.save_with_format(file(7), image::ImageFormat::Jpeg)
        .unwrap();
    fs::create_dir(bench.at("x")).unwrap();
    fs::remove_file(file(8)).unwrap();
    fs::create_dir(file(8)).unwrap();

    let result = bench.score().unwrap();
    let reasons: Vec<_> = result
        .failures
        .iter()
        .map(|f| (f.frame, f.reason.as_str()))
        .collect();
    for ((frame, reason), (expected_frame, expected)) in reasons.iter().zip([
        (0, "000000.png is missing"),
        (1, "000001.png is not a usable PNG"),
        (2, "000002.png is not a usable PNG"),
        (3, "000003.png is 16x8 pixels, expected 32x16"),
        (5, "000005.png is L8, expected 8-bit RGB"),
        (6, "000006.png is transparent in places"),
        (7, "000007.png is not a usable PNG"),
        (8, "000008.png cannot be read"),
    ]) {
        assert_eq!(*frame, expected_frame);
        assert!(reason.starts_with(expected), "{reason}");
        assert!(!reason.contains('\n') && !reason.contains(bench.folder.path().to_str().unwrap()));
    }
    assert_eq!(reasons.len(), 8);
    assert!(
        result
            .failures
            .iter()
            .all(|failure| failure.view == "input")
    );
    assert!(result.input_views.is_empty(), "no view, no mean");
    assert_eq!(result.novel_views["psnr"].views, 2);
}

#[test]
fn frames_with_two_predictions_or_another_name_are_failures() {
    let bench = Bench::new();
    let at = |name: &str| bench.at("input").join(name);
    fs::copy(at("000001.png"), at("1.png")).unwrap();
    fs::rename(at("000002.png"), at("0002.PNG")).unwrap();
    let result = bench.score().unwrap();
    assert_eq!(
        reasons(&result),
        [
            "000001.png and 1.png are both of frame 1",
            "000002.png is missing; 0002.PNG is not its name"
        ]
    );
}

/// Renders in another format are named, and previews beside a prediction change no score.
#[test]
fn images_in_other_formats_are_named() {
    let bench = Bench::new();
    let at = |name: &str| bench.at("input").join(name);
    for (png, other) in [
        ("000000.png", "0.JPG"),
        ("000001.png", "000001.exr"),
        ("000002.png", "frame_2.webp"),
    ] {
        fs::rename(at(png), at(other)).unwrap();
    }
    fs::copy(at("000003.png"), at("000003.jpg")).unwrap();
    let result = bench.score().unwrap();
    assert_eq!(
        reasons(&result),
        [
            "000000.png is missing; 0.JPG must be PNG or .npy",
            "000001.png is missing; 000001.exr must be PNG or .npy",
            "000002.png is missing"
        ]
    );
    // Such a format is named only where it lies beside a prediction of the same frame.
    let has = |part: &str| result.warnings.iter().any(|line| line.contains(part));
    assert!(!has("beyond the scored views"));
    assert!(has("000003.jpg") && !has("0.JPG"));
}

/// Without a single prediction the message has the images that are there.
#[test]
fn images_in_place_of_all_predictions_are_named() {
    let bench = Bench::new();
    let at = |name: &str| bench.at("novel").join(name);
    let reasons = || -> Vec<String> {
        let failures = bench.score().unwrap().failures;
        failures.into_iter().map(|failure| failure.reason).collect()
    };
    fs::create_dir(at("renders")).unwrap();
    for name in ["000004.png", "000009.png"] {
        fs::rename(at(name), at("renders").join(name)).unwrap();
    }
    let below = reasons();
    assert_eq!(below.len(), 2);
    for (reason, frame) in below.iter().zip(["000004.png", "000009.png"]) {
        assert!(
            reason.starts_with(&format!("{frame} is missing; ")),
            "{reason}"
        );
        assert!(reason.contains("renders"), "{reason}");
    }
    fs::rename(at("renders/000004.png"), at("IMG_7.png")).unwrap();
    assert!(reasons().iter().all(|reason| reason.contains("IMG_7.png")));
    // One that is in its place shows that the folder is the right one.
    fs::rename(at("renders/000009.png"), at("000009.png")).unwrap();
    assert_eq!(reasons(), ["000004.png is missing"]);
}

/// 16 bits, floats, and a PNG with an orientation.
#[test]
fn other_depths_and_orientations_are_failures() {
    let bench = Bench::new();
    let file = |frame: u32| bench.at("novel").join(format!("{frame:06}.png"));
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::new(WIDTH as u32, HEIGHT as u32);
    deep.save(file(4)).unwrap();
    let mut turned = fs::read(file(9)).unwrap();
    // An eXIf chunk behind the header, which is 33 bytes into the file: orientation 6.
    let exif: &[u8] = b"eXIfMM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let mut chunk = (exif.len() as u32 - 4).to_be_bytes().to_vec();
    chunk.extend(exif);
    chunk.extend(crc32(exif).to_be_bytes());
    turned.splice(33..33, chunk);
    fs::write(file(9), turned).unwrap();
    let result = bench.score().unwrap();
    assert_eq!(
        reasons(&result),
        [
            "000004.png is Rgb16, expected 8-bit RGB",
            "000009.png asks by its EXIF orientation to be turned or mirrored"
        ]
    );
}

/// The check sum of PNG chunks, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ (0xEDB8_8320 * (sum & 1))
        })
    })
}

#[test]
fn opaque_alpha_is_ignored() {
    let bench = Bench::new();
    let without = bench.score().unwrap();
    let rgb = image(4, 2).to_rgb8();
    let rgba: Vec<u8> = rgb
        .chunks_exact(3)
        .flat_map(|p| [p[0], p[1], p[2], 255])
        .collect();
    let image = image::RgbaImage::from_raw(WIDTH as u32, HEIGHT as u32, rgba).unwrap();
    image.save(bench.at("novel/000004.png")).unwrap();
    let with_alpha = bench.score().unwrap();
    assert_eq!(with_alpha.failures, []);
    assert_eq!(with_alpha.novel_views, without.novel_views);
}

/// Values of a prediction's image, with `error` bytes added, as fractions of 255.
fn values(frame: usize, error: u8, change: impl Fn(usize, f32) -> f32) -> Vec<f32> {
    let bytes = image(frame, error).to_rgb8();
    let values = bytes.iter().map(|&byte| f32::from(byte) / 255.0);
    values
        .enumerate()
        .map(|(at, value)| change(at, value))
        .collect()
}

#[test]
fn arrays_of_values_score_as_the_image_that_they_round_to() {
    let bench = Bench::new();
    let as_images = bench.score().unwrap();
    for (kind, frames, error) in [
        ("input", &bench.split.input_views, 1),
        ("novel", &bench.split.novel_views, 2),
    ] {
        for &frame in frames {
            fs::remove_file(bench.at(kind).join(format!("{frame:06}.png"))).unwrap();
            // Less than half a byte off, either way.
            let nudged = values(frame as usize, error, |at, value| {
                value + [0.0019, -0.0019][at % 2]
            });
            let file = bench.at(kind).join(format!("{frame:06}.npy"));
            npy::write_f32(&file, &[HEIGHT, WIDTH, 3], &nudged).unwrap();
        }
    }
    let as_arrays = bench.score().unwrap();
    assert_eq!(as_arrays.failures, []);
    // The files are others, the scores are the same.
    let predictions = as_images.predictions.clone();
    assert_ne!(as_arrays.predictions, predictions);
    let as_arrays = ResultRecord {
        predictions,
        ..as_arrays
    };
    assert_eq!(as_arrays, as_images);
}

#[test]
fn arrays_that_are_no_images_are_failures() {
    let bench = Bench::new();
    let write = |frame: u32, shape: &[usize], values: &[f32]| {
        let file = bench.at("input").join(format!("{frame:06}.npy"));
        npy::write_f32(&file, shape, values).unwrap();
    };
    for frame in [0, 1, 2, 3, 5, 6] {
        fs::remove_file(bench.at("input").join(format!("{frame:06}.png"))).unwrap();
    }
    let shape = [HEIGHT, WIDTH, 3];
    let at = WIDTH * 3 + 5;
    let with = |wrong: f32| values(0, 1, |index, value| if index == at { wrong } else { value });
    write(0, &shape, &with(f32::NAN));
    write(1, &shape, &with(f32::NEG_INFINITY));
    write(2, &shape, &values(2, 1, |_, value| 255.0 * value));
    write(3, &[3, HEIGHT, WIDTH], &values(3, 1, |_, value| value));
    // A value or two beyond the range of an image is what renderers give, and no fault.
    write(5, &shape, &with(1.5));
    fs::write(bench.at("input").join("000006.npy"), "no array").unwrap();
    write(7, &shape, &values(7, 1, |_, value| value));
    let result = bench.score().unwrap();
    let reasons = reasons(&result);
    let expected = [
        "000000.npy holds NaN in row 1, column 1".to_owned(),
        "000001.npy holds -inf in row 1, column 1".to_owned(),
        "000002.npy has a mean of".to_owned(),
        format!("000003.npy is of shape [3, {HEIGHT}, {WIDTH}], expected [{HEIGHT}, {WIDTH}, 3]"),
        "000006.npy: not a NumPy array, or cut off".to_owned(),
        "000007.npy and 000007.png are both of frame 7".to_owned(),
    ];
    assert_eq!(reasons.len(), expected.len(), "{reasons:?}");
    for (reason, expected) in reasons.iter().zip(&expected) {
        assert!(
            reason.starts_with(expected),
            "{reason}, expected {expected}"
        );
    }
}

#[test]
fn a_folder_that_is_not_there_is_no_folder_of_failures() {
    let bench = Bench::new();
    fs::remove_dir_all(bench.at("novel")).unwrap();
    fs::write(bench.at("novel"), "a file").unwrap();
    let refusal = bench.refusal();
    assert!(
        refusal.ends_with("novel: is not a folder of predictions"),
        "{refusal}"
    );
}

/// A table cannot tell such a method from the next one.
#[test]
fn a_method_without_a_plain_name_is_not_scored() {
    for name in ["", " ", "\t", "mine ", " mine", "mi\nne"] {
        let mut bench = Bench::new();
        bench.request.method = name.to_owned();
        assert!(bench.score().is_err(), "{name:?}");
        assert!(!bench.at("out").exists());
    }
}
