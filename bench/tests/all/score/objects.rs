//! Scores of single objects: their regions, their means over frames, and the means of their classes.

use std::collections::BTreeMap;

use omnilife_schemas::{
    object_scores::ObjectScores,
    records::{ObjectClass, ObjectResult, SceneObject, Summary},
};

use super::*;

/// PSNR of a mean squared error in squared bytes.
fn psnr(mse: f64) -> f64 {
    -10.0 * (mse / (255.0 * 255.0)).log10()
}

/// Marks the first eight rows of some columns.
fn columns(columns: std::ops::Range<usize>) -> Mask {
    let is_marked = |pixel: usize| columns.contains(&(pixel % WIDTH)) && pixel / WIDTH < 8;
    let data = (0..WIDTH * HEIGHT).map(|pixel| 255 * u8::from(is_marked(pixel)));
    Mask::new(WIDTH, HEIGHT, data.collect())
}

/// Two vehicles that overlap in frame 0, a person with a box in frame 1, a tree in a novel view, and a person in no
/// frame. Predictions are off by 4 bytes in frame 0, by 40 where the vehicles overlap in one pixel; by 8 in frame 1.
fn bench() -> Bench {
    let mut scene = scene(10, &[]);
    let listed = [
        ("bus", ObjectClass::Vehicle),
        ("car", ObjectClass::Vehicle),
        ("ghost", ObjectClass::Person),
        ("walker", ObjectClass::Person),
    ];
    scene.objects = listed
        .map(|(name, class)| (name.to_owned(), SceneObject { class }))
        .into();
    let masks = [
        (0, "car", 0..4),
        (0, "bus", 2..10),
        (1, "car", 0..4),
        (4, "tree", 0..8),
    ];
    for (frame, name, _) in &masks {
        let file = format!("masks/{name}-{frame}.png");
        let objects = &mut scene.frames[*frame].objects;
        objects.insert((*name).to_owned(), file);
    }
    let boxes = &mut scene.frames[1].boxes;
    boxes.insert("walker".to_owned(), [20.0, 4.0, 8.0, 8.0]);
    let bench = Bench::of(&scene);
    fs::create_dir(bench.at("scene/masks")).unwrap();
    for (frame, name, marked) in masks {
        let file = bench.at(&format!("scene/masks/{name}-{frame}.png"));
        columns(marked).write_png(&file).unwrap();
    }
    let mut first = image(0, 4);
    let both = 3 * 3..3 * 4;
    first.data[both.clone()].copy_from_slice(&image(0, 40).data[both]);
    first.write_png(&bench.at("input/000000.png")).unwrap();
    image(1, 8)
        .write_png(&bench.at("input/000001.png"))
        .unwrap();
    with_metrics(
        &bench,
        &[
            "psnr-static",
            "psnr-dynamic",
            "psnr-vehicle",
            "psnr-human",
            "psnr-object",
            "ssim-object",
        ],
    );
    bench
}

fn is_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
}

#[test]
fn regions_are_the_union_of_the_objects() {
    let result = bench().score().unwrap();
    assert!(result.regions.is_none());
    // 80 pixels of two vehicles, of which 16 are of both and count once.
    let first = psnr((79.0 * 16.0 + 1600.0) / 80.0);
    let dynamic = result.input_views["psnr-dynamic"];
    is_near(dynamic.mean, f64::midpoint(first, flat_psnr(8.0)));
    assert_eq!((dynamic.views, dynamic.undefined_views), (2, 6));
    let vehicles = result.input_views["psnr-vehicle"];
    is_near(vehicles.mean, f64::midpoint(first, flat_psnr(8.0)));
    let people = result.input_views["psnr-human"];
    is_near(people.mean, flat_psnr(8.0));
    assert_eq!((people.views, people.undefined_views), (1, 7));
    // Frames without objects are static as a whole.
    assert_eq!(result.input_views["psnr-static"].views, 8);
}

#[test]
fn objects_are_scored_over_their_frames_and_classes_over_their_objects() {
    let bench = bench();
    let result = bench.score().unwrap();
    let objects = result.objects.clone().unwrap();
    let of: BTreeMap<(&str, &str), &ObjectResult> = (objects.objects.iter())
        .map(|one| ((one.view.as_str(), one.object.as_str()), one))
        .collect();
    assert_eq!(of.len(), 10, "five objects of two kinds of views");
    let score = |view: &'static str, object: &'static str| {
        of[&(view, object)].scores.get("psnr-object").copied()
    };
    let [in_car, in_bus] = [32.0, 64.0].map(|pixels| {
        let sum = (pixels - 1.0) * 16.0 + 1600.0;
        psnr(sum / pixels)
    });
    let car: Summary = score("input", "car").unwrap();
    let car_deviation = (in_car - flat_psnr(8.0)).abs() / 2_f64.sqrt();
    is_near(car.mean, f64::midpoint(in_car, flat_psnr(8.0)));
    is_near(car.standard_deviation.unwrap(), car_deviation);
    assert_eq!((car.views, car.undefined_views), (2, 6));
    let bus = score("input", "bus").unwrap();
    is_near(bus.mean, in_bus);
    assert_eq!((bus.standard_deviation, bus.views), (None, 1));
    is_near(score("input", "walker").unwrap().mean, flat_psnr(8.0));
    is_near(score("novel", "tree").unwrap().mean, flat_psnr(2.0));
    for (view, object) in [("input", "tree"), ("input", "ghost"), ("novel", "car")] {
        assert!(of[&(view, object)].scores.is_empty(), "{view} {object}");
    }
    // A box of 4 columns is too narrow for SSIM.
    let has_ssim = |object: &'static str| of[&("input", object)].scores.contains_key("ssim-object");
    assert!(has_ssim("bus") && !has_ssim("car"));

    let vehicles = objects.of_class("input", ObjectClass::Vehicle, "psnr-object");
    let vehicles = vehicles.unwrap();
    is_near(vehicles.mean, f64::midpoint(car.mean, in_bus));
    is_near(vehicles.standard_deviation.unwrap(), car_deviation);
    assert_eq!(vehicles.objects, 2);
    let people = objects.of_class("input", ObjectClass::Person, "psnr-object");
    assert_eq!(people.unwrap().objects, 1);
    let others = objects.of_class("input", ObjectClass::Other, "psnr-object");
    assert_eq!(others, None);
    // The mean over views weighs frames, not objects.
    let first = f64::midpoint(in_car, in_bus);
    let second = flat_psnr(8.0);
    is_near(
        result.input_views["psnr-object"].mean,
        f64::midpoint(first, second),
    );

    let table = ObjectScores::read(&bench.at("out").join(&objects.table)).unwrap();
    let rows: Vec<_> = (table.rows.iter())
        .map(|row| (row.view.as_str(), row.frame, row.object.as_str()))
        .collect();
    assert_eq!(
        rows,
        [
            ("input", 0, "bus"),
            ("input", 0, "car"),
            ("input", 1, "car"),
            ("input", 1, "walker"),
            ("novel", 4, "tree"),
        ]
    );
    let scores: Vec<f64> = table.of("input", "car", "psnr-object").unwrap().collect();
    is_near(scores[0], in_car);
    is_near(scores[1], flat_psnr(8.0));
}

#[test]
fn scores_of_other_objects_are_of_another_scene() {
    let bench = bench();
    let first = bench.score().unwrap().scene_sha256;
    let mut scene: Scene = store::read_record(&bench.request.scene).unwrap();
    let write = |scene: &Scene| {
        store::write_record(&bench.request.scene, scene).unwrap();
        bench.score().unwrap().scene_sha256
    };
    scene.objects.insert(
        "tree".to_owned(),
        SceneObject {
            class: ObjectClass::Person,
        },
    );
    let reclassified = write(&scene);
    let sides = scene.frames[1].boxes.values_mut().next().unwrap();
    sides[2] = 9.0;
    let resized = write(&scene);
    assert!(first != reclassified && reclassified != resized);
    // Without metrics of objects there is no table of them.
    let plain = Bench::new();
    assert_eq!(plain.score().unwrap().objects, None);
    assert!(!plain.at("out/objects.csv").exists());
}
