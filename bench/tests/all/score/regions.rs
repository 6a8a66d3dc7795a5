//! Moving regions in scenes without masks: the boxes of the tracks beside the split.

use std::fs;

use omnilife_schemas::{
    RgbImage,
    records::{Track, Tracks},
    rgb::Mask,
    store,
    trajectory::{BSpline, ObjectPath},
};

use crate::score::{
    flat_psnr,
    scenes::{HEIGHT, WIDTH, scene},
    scoring::Bench,
    with_metrics,
};

/// A box that goes along ahead of the cameras, `ahead` units away.
pub(super) fn tracks(ahead: f64) -> Tracks {
    let path = ObjectPath {
        centre: BSpline {
            degree: 1,
            knots: vec![0.0, 0.0, 1.0, 1.0],
            coefficients: vec![[0.0, 0.0, ahead], [10.0, 0.0, ahead]],
        },
        heading_seconds: vec![0.0],
        headings: vec![0.0],
    };
    Tracks {
        scene: scene(1, &[]).id,
        frames: Vec::new(),
        image_size: [WIDTH as u32, HEIGHT as u32],
        up: [0.0, -1.0, 0.0],
        metres_per_unit: 1.0,
        stages: Vec::new(),
        detections: Vec::new(),
        tracks: vec![Track {
            id: 1,
            class: "vehicle".to_owned(),
            dimensions: [2.0; 3],
            path,
            detections: 8,
            displacement: 10.0,
        }],
        warnings: Vec::new(),
    }
}

#[test]
fn scenes_without_masks_are_scored_by_the_boxes_of_tracks() {
    let bench = Bench::new();
    with_metrics(&bench, &["psnr", "psnr-dynamic", "psnr-static"]);
    let without = bench.score().unwrap();
    assert_eq!(without.regions, None);
    assert!(
        without
            .unavailable
            .iter()
            .all(|one| one.reason == "the scene has no dynamic masks"),
        "{:?}",
        without.unavailable
    );

    let file = bench.at("tracks.json");
    store::write_record(&file, &tracks(4.0)).unwrap();
    // Wrong by far behind the camera alone: the box is ahead of it.
    let prediction = bench.at("novel/000004.png");
    let mut image = RgbImage::read(&prediction).unwrap();
    for pixel in (0..WIDTH * HEIGHT).filter(|pixel| pixel % WIDTH < WIDTH / 8) {
        image.data[3 * pixel..3 * pixel + 3].fill(1.0);
    }
    image.write_png(&prediction).unwrap();
    let result = bench.score().unwrap();
    let regions = result.regions.clone().unwrap();
    assert_eq!(regions.source, "tracks");
    assert!(result.unavailable.is_empty(), "{:?}", result.unavailable);
    let dynamic = result.novel_views["psnr-dynamic"];
    assert_eq!(dynamic.views, 2);
    assert!(
        (dynamic.mean - flat_psnr(2.0)).abs() < 1e-9,
        "{}",
        dynamic.mean
    );
    assert!(result.novel_views["psnr-static"].mean < flat_psnr(2.0) - 3.0);
    let told = result
        .warnings
        .iter()
        .filter(|warning| warning.contains("boxes that tracking found"));
    assert_eq!(told.count(), 1);
    // Found regions are not ground truth: the scene is the same.
    assert_eq!(result.scene_sha256, without.scene_sha256);

    // Other boxes, other regions; without that nothing is scored again.
    store::write_record(&file, &tracks(2.0)).unwrap();
    assert_ne!(bench.score().unwrap().regions, Some(regions));
    let mut others = tracks(4.0);
    others.scene = "another".to_owned();
    store::write_record(&file, &others).unwrap();
    assert!(
        bench
            .refusal()
            .ends_with("has the tracks of another, not of stripes/seq-000")
    );
    let mut unsound = tracks(4.0);
    unsound.tracks[0].dimensions[1] = -1.0;
    store::write_record(&file, &unsound).unwrap();
    assert!(bench.refusal().ends_with("track 1 has no box"));
}

#[test]
fn masks_of_the_scene_come_before_tracks() {
    let mut masked = scene(10, &[]);
    masked.frames[4].mask = Some("masks/4.png".to_owned());
    let bench = Bench::of(&masked);
    fs::create_dir(bench.at("scene/masks")).unwrap();
    let mask = Mask::new(WIDTH, HEIGHT, vec![255; WIDTH * HEIGHT]);
    mask.write_png(&bench.at("scene/masks/4.png")).unwrap();
    with_metrics(&bench, &["psnr-dynamic"]);
    store::write_record(&bench.at("tracks.json"), &tracks(4.0)).unwrap();
    let result = bench.score().unwrap();
    assert_eq!(result.regions, None);
    assert_eq!(result.novel_views["psnr-dynamic"].views, 1);
}
