//! Predictions of methods that were given images in padded frames.

use omnilife_schemas::{
    padded_frame::PaddedFrame,
    records::{Padding, Protocol},
};

use super::*;

/// Frames of the test, and the images of 32x16 pixels in them.
const FRAME: [u32; 2] = [20, 14];
const IMAGE: [u32; 2] = [20, 10];

fn frame() -> PaddedFrame {
    let frame = PaddedFrame::fit([WIDTH, HEIGHT].map(|side| side as u32), FRAME).unwrap();
    assert_eq!((frame.image(), frame.offset()), (IMAGE, [0, 2]));
    frame
}

/// A scene whose protocol has padded frames, without predictions.
fn padded_bench() -> Bench {
    let bench = Bench::new();
    let [width, height] = FRAME;
    let protocol = Protocol {
        padding: Padding::Frame { width, height },
        ..bench.split.protocol.clone()
    };
    let scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    for kind in ["input", "novel"] {
        fs::remove_dir_all(bench.at(kind)).unwrap();
        fs::create_dir(bench.at(kind)).unwrap();
    }
    bench
}

fn views(bench: &Bench) -> impl Iterator<Item = (&'static str, u32)> {
    let split = &bench.split;
    let of = |kind, frames: &[u32]| -> Vec<_> { frames.iter().map(|&f| (kind, f)).collect() };
    [
        of("input", &split.input_views),
        of("novel", &split.novel_views),
    ]
    .concat()
    .into_iter()
}

fn resized(frame: u32, error: u8) -> Vec<u8> {
    let [width, height] = IMAGE.map(|side| side as usize);
    image(frame as usize, error)
        .resized_by_area(width, height)
        .to_rgb8()
}

/// Writes the predictions, in padded frames with `around(place)` in the padding.
fn predict(bench: &Bench, error: u8, around: Option<fn(usize) -> u8>) {
    for (kind, number) in views(bench) {
        let image = resized(number, error);
        let ([width, height], bytes) = match around {
            None => (IMAGE, image),
            Some(around) => {
                let inside = frame().pad(&vec![1; image.len()], 3, 0_u8);
                let mut bytes = frame().pad(&image, 3, 0);
                for (place, byte) in bytes.iter_mut().enumerate() {
                    if inside[place] == 0 {
                        *byte = around(place);
                    }
                }
                (FRAME, bytes)
            }
        };
        let file = bench.at(kind).join(format!("{number:06}.png"));
        omnilife_schemas::rgb::write_rgb8_png(&file, width as usize, height as usize, &bytes)
            .unwrap();
    }
}

fn scores(bench: &Bench) -> FrameScores {
    let result = bench.score().unwrap();
    assert!(result.failures.is_empty(), "{:?}", result.failures);
    FrameScores::read(&bench.at("out/frames.csv")).unwrap()
}

#[test]
fn a_perfect_view_among_padding_is_perfect_and_the_result_has_its_rules() {
    let bench = padded_bench();
    predict(&bench, 0, Some(|_| 0));
    let result = bench.score().unwrap();
    for scores in [&result.input_views, &result.novel_views] {
        assert_eq!(scores["psnr"].mean, 100.0);
        assert!((scores["ssim"].mean - 1.0).abs() < 1e-12);
    }
    assert_eq!(result.scored_size, IMAGE);
    let rules = result.rules.unwrap();
    let [width, height] = FRAME;
    assert_eq!(rules.padding, Padding::Frame { width, height });
    assert_eq!(rules.hash(), result.protocol_hash);
    assert_ne!(result.protocol_hash, bench.split.protocol_hash);
}

#[test]
fn the_padding_counts_for_nothing() {
    let plain = padded_bench();
    predict(&plain, 3, None);
    let expected = scores(&plain);
    let garbage: fn(usize) -> u8 = |place| (place * 89 % 256) as u8;
    let padded = padded_bench();
    predict(&padded, 3, Some(garbage));
    assert_eq!(scores(&padded).rows, expected.rows);
    // Arrays of other values than numbers, where nothing counts.
    let arrays = padded_bench();
    for (kind, number) in views(&arrays) {
        let image = resized(number, 3).into_iter();
        let image: Vec<f32> = image.map(|byte| f32::from(byte) / 255.0).collect();
        let values = frame().pad(&image, 3, f32::NAN);
        let [width, height] = FRAME.map(|side| side as usize);
        let file = arrays.at(kind).join(format!("{number:06}.npy"));
        npy::write_f32(&file, &[height, width, 3], &values).unwrap();
    }
    assert_eq!(scores(&arrays).rows, expected.rows);
}

#[test]
fn views_of_neither_size_are_failures() {
    let bench = padded_bench();
    predict(&bench, 0, Some(|_| 0));
    let file = |frame: u32| bench.at("novel").join(format!("{frame:06}.png"));
    // The scene's own size, and an image that was padded on one side alone.
    image(4, 0).write_png(&file(4)).unwrap();
    let cut = RgbImage::from_rgb8(20, 12, &[0; 20 * 12 * 3]);
    cut.write_png(&file(9)).unwrap();
    let result = bench.score().unwrap();
    let failed: Vec<u32> = result.failures.iter().map(|one| one.frame).collect();
    assert_eq!(failed, [4, 9]);
    // A frame is not a prediction where the protocol has none.
    let plain = Bench::new();
    predict(&plain, 0, Some(|_| 0));
    assert_eq!(plain.score().unwrap().failures.len(), 10);
}

#[test]
fn distances_are_taken_without_their_padding() {
    let bench = padded_bench();
    let scene = {
        let mut scene: Scene = store::read_record(&bench.request.scene).unwrap();
        for frame in &mut scene.frames {
            frame.depth = Some(DepthImage {
                file: "depth.png".to_owned(),
                unit: 0.5,
            });
        }
        store::write_record(&bench.request.scene, &scene).unwrap();
        scene
    };
    image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(
        WIDTH as u32,
        HEIGHT as u32,
        image::Luma([6]),
    )
    .save(bench.at("scene/depth.png"))
    .unwrap();
    let [width, height] = FRAME;
    let mut protocol = bench.split.protocol.clone();
    protocol.padding = Padding::Frame { width, height };
    protocol.metrics.push("depth-abs-rel".to_owned());
    let split = omnilife_bench::split(&scene, &protocol).unwrap();
    store::write_record(&bench.request.split, &split).unwrap();
    predict(&bench, 0, Some(|_| 0));
    for kind in ["input", "novel"] {
        fs::create_dir(bench.at(kind).join("depth")).unwrap();
    }
    for (kind, number) in views(&bench) {
        let distances = frame().pad(&[3.3_f32; 200], 1, -1.0);
        let file = bench.at(kind).join(format!("depth/{number:06}.npy"));
        npy::write_f32(&file, &[height as usize, width as usize], &distances).unwrap();
    }
    let result = bench.score().unwrap();
    assert!((result.novel_views["depth-abs-rel"].mean - 0.1).abs() < 1e-6);
}
