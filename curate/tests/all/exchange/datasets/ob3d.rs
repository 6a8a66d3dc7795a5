//! Captures in the shape of `blender_script/generate_trajectory-data.py` of OB3D.

use serde_json::json;

use super::*;
use crate::exchange::foreign::notes;

const FRAMES: [(&str, u8); 4] = [
    ("images/00000_rgb.png", 1),
    ("images/00001_rgb.png", 2),
    ("images/00002_rgb.png", 3),
    ("images/00003_rgb.png", 4),
];

/// `convert_blender_to_opencv`: rotation and translation, world to camera.
fn extrinsics(number: u8) -> (DMat3, DVec3) {
    let (turn, place) = placed(number);
    let axes = DMat3::from_diagonal(dvec3(1.0, -1.0, -1.0));
    let rotation = axes * turn.transpose();
    (rotation, axes * -(turn.transpose() * place))
}

fn camera(number: u8) -> Value {
    let (rotation, translation) = extrinsics(number);
    json!([{
        "id": number - 1,
        "width": 32,
        "height": 16,
        "intrinsics": {"focal": 16, "cx": 16.0, "cy": 8.0},
        "extrinsics": {
            "rotation": rows(rotation),
            "translation": translation.to_array(),
        },
    }])
}

fn camera_file(number: u8) -> String {
    format!("cameras/{:05}_cam.json", number - 1)
}

fn ob3d() -> Foreign {
    let foreign = Foreign::new(SIZE, &FRAMES);
    for number in 1..=4 {
        foreign.write(&camera_file(number), camera(number).to_string());
    }
    foreign.write("depths/00000_depth.exr", b"\x76\x2f\x31\x01");
    foreign.write("normals/00000_normal.exr", b"\x76\x2f\x31\x01");
    foreign.write(
        "sparse/sparse.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1.5 -2.25 0.125 9 8 7\n",
    );
    foreign.write("train.txt", "00000\n00003\n00001_rgb.png\n");
    foreign.write("test.txt", "2\n");
    foreign
}

/// The rays of `equirectangular_renderer_from_mesh`, solved for the pixel: `phi` from -180 to 180 degrees over the
/// width, `theta` from -90 to 90 over the height, `(cos theta sin phi, sin theta, cos theta cos phi)`.
fn pixel(number: u8, world: DVec3) -> [f64; 2] {
    let (rotation, translation) = extrinsics(number);
    let ray = rotation * world + translation;
    let (phi, theta) = (ray.x.atan2(ray.z), (ray.y / ray.length()).asin());
    [(phi + PI) / TAU * 32.0, (theta + PI / 2.0) / PI * 16.0]
}

#[test]
fn cameras_see_what_the_renderer_sees() {
    let foreign = ob3d();
    let scene = import_as_is(&foreign, "ob3d").unwrap();
    for (frame, number) in [1, 2, 3, 4].into_iter().enumerate() {
        assert_sees(&scene, frame, placed(number).1, |world| {
            pixel(number, world)
        });
    }
    assert_eq!(times(&scene), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(split_of(&scene), (vec![0, 1, 3], vec![2]));
    let points = PointCloud::read_ply(&foreign.path().join("out/points.ply")).unwrap();
    assert_eq!(points.positions, [[1.5, -2.25, 0.125]]);
}

#[test]
fn what_is_not_read_is_told() {
    let scene = import_as_is(&ob3d(), "ob3d").unwrap();
    assert!(scene.frames.iter().all(|frame| frame.depth.is_none()));
    assert!(notes(&scene, "00000_depth.exr") && notes(&scene, "normals"));
}

#[test]
fn captures_that_are_not_whole_are_refused_or_told() {
    let foreign = ob3d();
    fs::remove_file(foreign.path().join("in/images/00002_rgb.png")).unwrap();
    let scene = foreign.import("ob3d").unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert!(scene.published_split.is_none() && notes(&scene, "images/00002_rgb.png"));
    let refused = |camera: &Value, what: &str| {
        foreign.write(&camera_file(2), camera.to_string());
        let line = foreign.refusal("ob3d");
        assert!(line.contains(what), "{line}");
        assert!(line.contains("00001_cam.json"), "{line}");
    };
    let mut sheared = camera(2);
    sheared[0]["extrinsics"]["rotation"][1][1] = json!(3.0);
    refused(&sheared, "must be a rotation");
    let mut larger = camera(2);
    larger[0]["width"] = json!(64);
    refused(&larger, "64x16");
    refused(&json!([camera(2)[0], camera(3)[0]]), "2 cameras");
    refused(&json!([]), "0 cameras");
    let text = camera(2).to_string();
    let (before, after) = text.split_once("\"translation\":[").unwrap();
    let (_, after) = after.split_once(',').unwrap();
    foreign.write(
        &camera_file(2),
        format!("{before}\"translation\":[NaN,{after}"),
    );
    assert!(foreign.refusal("ob3d").contains("00001_cam.json"));
}

#[test]
fn a_scene_of_two_captures_asks_for_one() {
    let foreign = Foreign::new(SIZE, &[("Egocentric/images/00000_rgb.png", 1)]);
    foreign.write("Egocentric/cameras/00000_cam.json", camera(1).to_string());
    assert!(foreign.refusal("ob3d").contains("Non-Egocentric"));
    let scene = foreign.import_from("Egocentric", "ob3d").unwrap();
    assert!(scene.published_split.is_none() && notes(&scene, "train.txt"));
}
