//! Lenses of other programs: every straightened pixel shows what lies on its ray.

use glam::dvec2;
use omnilife_schemas::{RgbImage, camera::Camera};
use serde_json::json;

use super::{
    foreign::{Foreign, notes, transform_matrix, write_colmap_binary, write_colmap_text},
    *,
};

const SIZE: [u32; 2] = [112, 80];
/// fx, fy, cx, cy.
const INTRINSICS: [f64; 4] = [86.0, 84.5, 57.5, 38.25];

/// Goes up and down by 1 every 8 pixels: its value tells the place to a thirtieth of a pixel.
fn ramp(pixels: f64) -> f64 {
    (pixels / 8.0 % 2.0 - 1.0).abs()
}

/// An image that tells places, and a mask with the left of it black.
fn paint(foreign: &Foreign) {
    foreign.paint("images/7.png", |x, y| {
        let byte = |pixels: u32| (255.0 * ramp(f64::from(pixels) + 0.5)).round() as u8;
        [byte(x), byte(y), 90]
    });
    foreign.paint("masks/7.png.png", |x, _| {
        [255 * u8::from(x >= SIZE[0] / 2); 3]
    });
}

/// Returns the place of a direction behind a lens with `k1 k2 k3 p1 p2`, by the formula of OpenCV.
fn opencv([k1, k2, k3, p1, p2]: [f64; 5]) -> impl Fn(f64, f64) -> [f64; 2] {
    move |x, y| {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }
}

/// The same behind a fisheye with `k1 k2 k3 k4`, by the angle to the axis.
fn fisheye([k1, k2, k3, k4]: [f64; 4]) -> impl Fn(f64, f64) -> [f64; 2] {
    move |x, y| {
        let angle = x.hypot(y).atan();
        let square = angle * angle;
        let series = 1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)));
        let (sine, cosine) = y.atan2(x).sin_cos();
        [cosine, sine].map(|of_axis| of_axis * angle * series)
    }
}

/// Every pixel of the imported frame shows what the lens shows on its ray, to 0.05 pixels.
fn assert_straight(
    foreign: &Foreign,
    scene: &Scene,
    lens: impl Fn(f64, f64) -> [f64; 2],
    [fx, fy]: [f64; 2],
) {
    let Camera::Pinhole(camera) = scene.camera else {
        panic!("{:?}", scene.camera);
    };
    assert!(notes(scene, "is taken out of the frames") || notes(scene, "made perspective"));
    let out = foreign.path().join("out");
    let image = RgbImage::read(&out.join(&scene.frames[0].image)).unwrap();
    let mask = scene.frames[0].mask.as_ref();
    let mask = mask.map(|file| Mask::read(&out.join(file)).unwrap());
    let [width, height] = SIZE.map(|side| side as usize);
    assert_eq!((image.width, image.height), (width, height));
    let mut compared = 0;
    for (pixel, colour) in image.data.as_chunks::<3>().0.iter().enumerate() {
        let x = ((pixel % width) as f64 + 0.5 - camera.cx) / camera.fx;
        let y = ((pixel / width) as f64 + 0.5 - camera.cy) / camera.fy;
        let [u, v] = lens(x, y);
        let source = dvec2(fx * u + INTRINSICS[2], fy * v + INTRINSICS[3]);
        for (place, value) in source.to_array().into_iter().zip(colour) {
            // Not where the ramp turns, or beyond the centres of the outermost pixels.
            if (1.0..7.0).contains(&(place % 8.0)) {
                let error = 8.0 * (f64::from(*value) - ramp(place)).abs();
                assert!(error < 0.05, "pixel {pixel}: {error}");
                compared += 1;
            }
        }
        if let Some(mask) = &mask
            && (source.x - 56.0).abs() > 1.0
        {
            assert_eq!(mask.data[pixel] > 127, source.x < 56.0, "pixel {pixel}");
        }
    }
    assert!(compared > width * height);
}

#[test]
fn frames_of_colmap_models_are_straightened() {
    let [fx, fy, cx, cy] = INTRINSICS;
    let simple = [fx, cx, cy, -0.13];
    let radial = [fx, cx, cy, 0.07, 0.02];
    let full = [fx, fy, cx, cy, -0.09, 0.015, 0.003, -0.002];
    /// Name, number, parameters as COLMAP writes them; terms of the lens, focal lengths.
    type LensModel<'a> = (&'a str, i32, &'a [f64], [f64; 5], [f64; 2]);
    let models: [LensModel<'_>; 3] = [
        (
            "SIMPLE_RADIAL",
            2,
            &simple,
            [-0.13, 0.0, 0.0, 0.0, 0.0],
            [fx, fx],
        ),
        ("RADIAL", 3, &radial, [0.07, 0.02, 0.0, 0.0, 0.0], [fx, fx]),
        (
            "OPENCV",
            4,
            &full,
            [-0.09, 0.015, 0.0, 0.003, -0.002],
            [fx, fy],
        ),
    ];
    for (name, number, parameters, terms, focal) in models {
        let foreign = Foreign::new(SIZE, &[]);
        paint(&foreign);
        let [width, height] = SIZE;
        let words: Vec<String> = parameters.iter().map(f64::to_string).collect();
        let camera = format!("3 {name} {width} {height} {}\n", words.join(" "));
        let rows = [(5, 3, "7.png", 7)];
        write_colmap_text(&foreign, "sparse/0", &camera, &rows);
        let scene = foreign.import("colmap").unwrap();
        assert_straight(&foreign, &scene, opencv(terms), focal);
        assert!(scene.frames[0].mask.is_some());
        // The binary model beside it is read in its place.
        let cameras = [(3, number, SIZE.map(u64::from), parameters)];
        write_colmap_binary(&foreign, "sparse/0", &cameras, &rows);
        let binary = foreign.import("colmap-binary").unwrap();
        assert_straight(&foreign, &binary, opencv(terms), focal);
        assert_eq!(scene.camera, binary.camera);
    }
}

/// Parameters of another model under this name would be taken for its first ones.
#[test]
fn cameras_with_other_numbers_of_parameters_are_refused() {
    for camera in [
        "3 SIMPLE_RADIAL 112 80 86 57.5 38.25 -0.1 0.02",
        "3 PINHOLE 112 80 86 84.5 57.5 38.25 0",
        "3 OPENCV_FISHEYE 112 80 86 84.5 57.5 38.25 0.1 0 0",
    ] {
        let foreign = Foreign::new(SIZE, &[]);
        paint(&foreign);
        write_colmap_text(
            &foreign,
            "sparse/0",
            &format!("{camera}\n"),
            &[(5, 3, "7.png", 7)],
        );
        let error = foreign.import("colmap").map(drop).unwrap_err().to_string();
        assert!(error.contains("cameras.txt"), "{error}");
        assert!(!foreign.path().join("out").exists());
    }
}

/// A `transforms.json` with one frame, and these entries of its camera.
fn transforms(camera: &Value, of_frame: bool) -> String {
    let mut frame = json!({"file_path": "./images/7.png", "transform_matrix": transform_matrix(7)});
    let mut file = json!({});
    let to = if of_frame { &mut frame } else { &mut file };
    for (name, value) in camera.as_object().unwrap() {
        to[name] = value.clone();
    }
    file["frames"] = json!([frame]);
    file.to_string()
}

#[test]
fn frames_of_nerfstudio_are_straightened() {
    let [fx, fy, cx, cy] = INTRINSICS;
    let [w, h] = SIZE;
    let entries = json!({
        "camera_model": "OPENCV", "w": w, "h": h, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        "k1": -0.11, "k2": 0.01, "k3": 0.0, "k4": 0.0, "p1": -0.002, "p2": 0.001,
    });
    for of_frame in [false, true] {
        let foreign = Foreign::new(SIZE, &[]);
        paint(&foreign);
        foreign.write("transforms.json", transforms(&entries, of_frame));
        let scene = foreign.import("nerfstudio").unwrap();
        assert_straight(
            &foreign,
            &scene,
            opencv([-0.11, 0.01, 0.0, -0.002, 0.001]),
            [fx, fy],
        );
    }
    let foreign = Foreign::new(SIZE, &[]);
    paint(&foreign);
    let with = |changes: Value| {
        let mut other = entries.clone();
        for (name, value) in changes.as_object().unwrap() {
            other[name] = value.clone();
        }
        foreign.write("transforms.json", transforms(&other, true));
        foreign.import("nerfstudio").unwrap()
    };
    let third = with(json!({"k3": 0.004}));
    assert_straight(
        &foreign,
        &third,
        opencv([-0.11, 0.01, 0.004, -0.002, 0.001]),
        [fx, fy],
    );
    // As the two programs mark a fisheye.
    for mark in [
        json!({"camera_model": "OPENCV_FISHEYE", "k1": 0.02, "k3": 0.003, "p1": 0.0, "p2": 0.0}),
        json!({"is_fisheye": true, "k1": 0.02, "k3": 0.003, "p1": 0.0, "p2": 0.0}),
    ] {
        let scene = with(mark);
        assert_straight(
            &foreign,
            &scene,
            fisheye([0.02, 0.01, 0.003, 0.0]),
            [fx, fy],
        );
    }
    for (entry, value) in [
        ("camera_model", json!("ORTHOPHOTO")),
        ("k5", json!(0.0)),
        ("is_fisheye", json!(3)),
        ("lens_model", json!("x")),
        ("fl_x", json!("86")),
        ("fl_x", json!(0.0)),
        ("w", json!(112.5)),
    ] {
        let mut other = entries.clone();
        other[entry] = value;
        foreign.write("transforms.json", transforms(&other, false));
        let line = foreign.refusal("nerfstudio");
        let named = if entry == "fl_x" || entry == "camera_model" {
            line.contains("focal length") || line.contains(entry) || line.contains("ORTHOPHOTO")
        } else {
            line.contains(entry)
        };
        assert!(named, "{entry}: {line}");
    }
}

#[test]
fn a_scene_has_one_camera_and_that_is_said_by_name() {
    let foreign = Foreign::new(SIZE, &[("images/1.png", 1), ("images/2.png", 2)]);
    let rows = [(1, 4, "1.png", 1), (2, 6, "2.png", 2)];
    let same = "1 SPHERE 112 80 80 30 40\n4 PINHOLE 112 80 80 80 56 40\n6 PINHOLE 112 80 80 80 56 ";
    // Two cameras that are one, and one of another model that no image has.
    write_colmap_text(&foreign, "sparse", &format!("{same}40.00000001\n"), &rows);
    let scene = foreign.import("colmap").unwrap();
    assert_eq!(scene.frames.len(), 2);
    write_colmap_text(&foreign, "sparse", &format!("{same}41\n"), &rows);
    let line = foreign.refusal("colmap");
    assert!(line.contains("1.png") && line.contains("2.png"), "{line}");
    write_colmap_text(
        &foreign,
        "sparse",
        &format!("{same}40\n"),
        &[(1, 1, "1.png", 1)],
    );
    let line = foreign.refusal("colmap");
    assert!(line.contains("SPHERE") && line.contains("line 2"), "{line}");
    // A negative focal length.
    let impossible = [-80.0, 80.0, 56.0, 40.0, 0.0, 0.0, 0.0, 0.0];
    let pinhole = [80.0, 80.0, 56.0, 40.0];
    let cameras: [(u32, i32, [u64; 2], &[f64]); 2] =
        [(1, 5, [112, 80], &impossible), (4, 1, [112, 80], &pinhole)];
    write_colmap_binary(&foreign, "sparse", &cameras, &rows[..1]);
    assert_eq!(foreign.import("colmap").unwrap().frames.len(), 1);
    write_colmap_binary(&foreign, "sparse", &cameras, &[(1, 1, "1.png", 1)]);
    assert!(foreign.refusal("colmap").contains("OPENCV_FISHEYE"));

    let camera = |focal: f64, model: &str| json!({"camera_model": model, "w": 112, "h": 80, "fl_x": focal, "fl_y": 80.0, "cx": 56.0, "cy": 40.0});
    for (second, entry) in [
        (camera(80.5, "OPENCV"), "fl_x"),
        (camera(80.0, "EQUIRECTANGULAR"), "camera_model"),
    ] {
        let frames: Vec<Value> = [(1, camera(80.0, "OPENCV")), (2, second)]
            .into_iter()
            .map(|(number, mut frame)| {
                frame["file_path"] = json!(format!("images/{number}.png"));
                frame["transform_matrix"] = transform_matrix(number);
                frame
            })
            .collect();
        foreign.write("transforms.json", json!({"frames": frames}).to_string());
        let line = foreign.refusal("nerfstudio");
        assert!(
            line.contains(entry) && line.contains("images/2.png"),
            "{line}"
        );
    }
}

/// Resampling would cost more than such a lens does.
#[test]
fn a_weak_lens_stays_and_is_told() {
    let foreign = Foreign::new(SIZE, &[]);
    paint(&foreign);
    let camera = "1 SIMPLE_RADIAL 112 80 86 56 40 0.0015\n";
    write_colmap_text(&foreign, "sparse", camera, &[(1, 1, "7.png", 7)]);
    let scene = foreign.import("colmap").unwrap();
    assert!(notes(&scene, "stays in the frames"));
    let kept = RgbImage::read(&foreign.path().join("out").join(&scene.frames[0].image)).unwrap();
    let original = RgbImage::read(&foreign.path().join("in/images/7.png")).unwrap();
    assert_eq!(kept, original);
}
