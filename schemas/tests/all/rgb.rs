//! Images: area resizing, 8-bit conversion, files.

use std::fs;

use omnilife_schemas::{RgbImage, rgb::Mask};
use proptest::prelude::*;

fn images() -> impl Strategy<Value = RgbImage> {
    (1_usize..40, 1_usize..40).prop_flat_map(|(width, height)| {
        prop::collection::vec(0.0_f32..=1.0, width * height * 3).prop_map(move |data| RgbImage {
            width,
            height,
            data,
        })
    })
}

fn channel_means(image: &RgbImage) -> [f64; 3] {
    let pixels = (image.width * image.height) as f64;
    let mut sums = [0.0; 3];
    for pixel in image.data.chunks_exact(3) {
        for (sum, &value) in sums.iter_mut().zip(pixel) {
            *sum += f64::from(value);
        }
    }
    sums.map(|sum| sum / pixels)
}

/// Computes the definition, in f64 and one pixel at a time: the mean over the footprint.
fn reference_pixel(image: &RgbImage, size: [usize; 2], at: [usize; 2], channel: usize) -> f64 {
    let ratios = [
        image.width as f64 / size[0] as f64,
        image.height as f64 / size[1] as f64,
    ];
    let overlap = |axis: usize, source: usize| {
        let begin = (at[axis] as f64 * ratios[axis]).max(source as f64);
        let end = ((at[axis] + 1) as f64 * ratios[axis]).min(source as f64 + 1.0);
        (end - begin).max(0.0)
    };
    let mut sum = 0.0;
    for y in 0..image.height {
        for x in 0..image.width {
            let value = f64::from(image.data[(y * image.width + x) * 3 + channel]);
            sum += overlap(0, x) * overlap(1, y) * value;
        }
    }
    sum / (ratios[0] * ratios[1])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn area_resizing_is_the_mean_over_the_footprint(
        image in images(), width in 1_usize..40, height in 1_usize..40
    ) {
        let resized = image.resized_by_area(width, height);
        prop_assert_eq!(resized.data.len(), width * height * 3);
        for y in 0..height {
            for x in 0..width {
                for channel in 0..3 {
                    let expected = reference_pixel(&image, [width, height], [x, y], channel);
                    let value = f64::from(resized.data[(y * width + x) * 3 + channel]);
                    prop_assert!((value - expected).abs() < 2e-6, "{} {}", value, expected);
                }
            }
        }
    }

    #[test]
    fn area_resizing_keeps_the_mean(
        image in images(), width in 1_usize..40, height in 1_usize..40
    ) {
        let means = channel_means(&image);
        for (resized, mean) in channel_means(&image.resized_by_area(width, height))
            .into_iter()
            .zip(means)
        {
            prop_assert!((resized - mean).abs() < 1e-6);
        }
    }

    #[test]
    fn the_same_size_is_the_same_image(image in images()) {
        prop_assert_eq!(image.resized_by_area(image.width, image.height), image);
    }

    #[test]
    fn eight_bits_come_back(bytes in prop::collection::vec(any::<u8>(), 12)) {
        prop_assert_eq!(RgbImage::from_rgb8(2, 2, &bytes).to_rgb8(), bytes);
    }
}

#[test]
fn enlarging_by_whole_numbers_repeats_pixels() {
    let image = RgbImage::from_rgb8(2, 1, &[10, 20, 30, 200, 210, 220]);
    let enlarged = image.resized_by_area(4, 2).to_rgb8();
    let row = [10, 20, 30, 10, 20, 30, 200, 210, 220, 200, 210, 220];
    assert_eq!(enlarged, [row, row].concat());
}

#[test]
fn values_out_of_range_are_clamped_and_nan_is_black() {
    let image = RgbImage {
        width: 2,
        height: 1,
        data: vec![-1.0, 2.0, f32::NAN, 0.5, f32::INFINITY, f32::NEG_INFINITY],
    };
    assert_eq!(image.to_rgb8(), [0, 255, 0, 128, 255, 0]);
}

#[test]
fn png_files_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000004.png");
    let bytes: Vec<u8> = (0..7 * 5 * 3).map(|i| (i * 37 % 256) as u8).collect();
    let image = RgbImage::from_rgb8(7, 5, &bytes);
    image.write_png(&path).unwrap();
    assert_eq!(RgbImage::read(&path).unwrap(), image);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn masks_are_black_or_white() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mask.png");
    let grey = [0, 127, 128, 255].map(|value| [value; 3]).concat();
    omnilife_schemas::rgb::write_rgb8_png(&path, 4, 1, &grey).unwrap();
    let mask = Mask::read(&path).unwrap();
    assert_eq!((mask.width, mask.height), (4, 1));
    assert_eq!(mask.data, [0, 0, 255, 255]);
}

#[test]
fn files_that_are_no_images_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    RgbImage::black(64, 32).write_png(&path).unwrap();
    let whole = fs::read(&path).unwrap();
    for content in [&b""[..], b"hello", &whole[..whole.len() / 2]] {
        fs::write(&path, content).unwrap();
        let image = RgbImage::read(&path).unwrap_err().to_string();
        let mask = Mask::read(&path).unwrap_err().to_string();
        for message in [image, mask] {
            assert!(message.contains("not a usable image"), "{message}");
            assert!(!message.contains('\n'), "{message}");
        }
    }
    assert!(RgbImage::read(&folder.path().join("none.png")).is_err());
}

#[test]
fn nearest_resampling_keeps_halves() {
    let mask = Mask::new(4, 2, vec![0, 0, 255, 255, 0, 0, 255, 255]);
    let large = mask.resized_to_nearest(8, 4);
    assert!(
        large
            .data
            .chunks(8)
            .all(|row| row == [0, 0, 0, 0, 255, 255, 255, 255])
    );
    assert_eq!(large.resized_to_nearest(4, 2), mask);
}

#[test]
fn masks_survive_a_file_and_two_inversions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mask.png");
    let mask = Mask::new(3, 1, vec![0, 255, 0]);
    mask.write_png(&path).unwrap();
    assert_eq!(Mask::read(&path).unwrap(), mask);
    assert_eq!(mask.clone().inverted().data, [255, 0, 255]);
    assert_eq!(mask.clone().inverted().inverted(), mask);
}
