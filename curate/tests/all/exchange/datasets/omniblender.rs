//! Scenes in the shape of `dataLoader/dataset_omniblender.py` of `EgoNeRF`.

use serde_json::json;

use super::*;
use crate::exchange::foreign::notes;

/// Frames in an order of their own, as the file may have them.
const FRAMES: [(&str, u8); 4] = [
    ("images/00010.png", 4),
    ("images/00002.png", 2),
    ("images/00003.png", 3),
    ("images/00001.png", 1),
];

fn transforms(frames: &[(&str, u8)]) -> Value {
    let frames: Vec<Value> = (frames.iter())
        .map(|(name, number)| {
            let (turn, place) = placed(*number);
            let [x, y, z] = rows(turn);
            let row = |row: [f64; 3], at: f64| [row[0], row[1], row[2], at];
            json!({
                "file_path": name.strip_prefix("images/").unwrap(),
                "transform_matrix":
                    [row(x, place.x), row(y, place.y), row(z, place.z), [0.0, 0.0, 0.0, 1.0]],
            })
        })
        .collect();
    json!({"indoor": true, "width": 32, "height": 16, "frames": frames})
}

fn omniblender() -> Foreign {
    let foreign = Foreign::new(SIZE, &FRAMES);
    foreign.write("transform.json", transforms(&FRAMES).to_string());
    foreign.write("train.txt", "00001\n00010\n");
    foreign.write("test.txt", "00003\n");
    foreign
}

/// `get_ray_directions_360`, solved for the pixel: `phi = (1 - 2 i / W) pi`, `theta = (1 - 2 j / H) pi / 2`,
/// `(-cos theta sin phi, sin theta, -cos theta cos phi)`, turned by `c2w[:3, :3]`.
fn pixel(number: u8, world: DVec3) -> [f64; 2] {
    let (turn, place) = placed(number);
    let ray = turn.transpose() * (world - place);
    let theta = (ray.y / ray.length()).asin();
    let phi = (-ray.x).atan2(-ray.z);
    [
        (1.0 - phi / PI) * 32.0 / 2.0,
        (1.0 - 2.0 * theta / PI) * 16.0 / 2.0,
    ]
}

#[test]
fn cameras_see_what_the_loader_sees() {
    let scene = import_as_is(&omniblender(), "omniblender").unwrap();
    assert_eq!(scene.camera, CAMERA.into());
    for (frame, number) in [1, 2, 3, 4].into_iter().enumerate() {
        assert_sees(&scene, frame, placed(number).1, |world| {
            pixel(number, world)
        });
    }
    // By their numbers: nothing moves.
    assert_eq!(times(&scene), [0.0, 1.0, 2.0, 9.0]);
    assert!(notes(&scene, "--fps gives another rate"));
    assert!(scene.frames.iter().all(|frame| frame.depth.is_none()));
}

#[test]
fn the_lists_are_the_published_split() {
    let foreign = omniblender();
    let scene = foreign.import("omniblender").unwrap();
    assert_eq!(split_of(&scene), (vec![0, 3], vec![2]));
    assert!(notes(&scene, "without a part in the published split"));
    assert_eq!(times(&scene), [0.0, 0.1, 0.2, 0.9]);
    let written: Scene = store::read_record(&foreign.path().join("out/scene.json")).unwrap();
    assert_eq!(written.published_split, scene.published_split);
}

#[test]
fn a_folder_that_is_no_whole_scene_is_refused_or_told() {
    let foreign = omniblender();
    let file = |name: &str| foreign.path().join("in").join(name);
    fs::remove_file(file("images/00002.png")).unwrap();
    let scene = foreign.import("omniblender").unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert!(notes(&scene, "images/00002.png"));
    // No view of the split is missing.
    assert_eq!(split_of(&scene), (vec![0, 2], vec![1]));
    fs::remove_file(file("images/00003.png")).unwrap();
    let scene = foreign.import("omniblender").unwrap();
    assert!(scene.published_split.is_none() && notes(&scene, "split (OmniBlender"));

    for (bad, what) in [("NaN", "transform.json"), ("2.5", "no rigid transform")] {
        let mut changed = transforms(&FRAMES);
        changed["frames"][1]["transform_matrix"][0][0] = json!("bad");
        let text = changed.to_string().replace("\"bad\"", bad);
        foreign.write("transform.json", text);
        let line = foreign.refusal("omniblender");
        assert!(line.contains(what), "{line}");
    }
    fs::copy(file("images/00001.png"), foreign.path().join("other.png")).unwrap();
    let mut outside = transforms(&FRAMES);
    outside["frames"][0]["file_path"] = json!("../../other.png");
    foreign.write("transform.json", outside.to_string());
    assert!(foreign.refusal("omniblender").contains("leads out"));
    fs::remove_file(file("transform.json")).unwrap();
    assert!(foreign.refusal("omniblender").contains("transform.json"));
}

#[test]
fn images_that_are_no_whole_spheres_are_refused() {
    let foreign = Foreign::new([32, 24], &FRAMES);
    foreign.write("transform.json", transforms(&FRAMES).to_string());
    let line = foreign.refusal("omniblender");
    assert!(line.contains("32x24"), "{line}");
}
