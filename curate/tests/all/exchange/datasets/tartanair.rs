//! Trajectories in the shape of `tartanair/dataset.py` and `tartanair/reader.py` of `TartanAir` V2.

use std::io::Cursor;

use super::*;
use crate::exchange::foreign::notes;

const IMAGES: [(&str, u8); 3] = [
    ("image_lcam_equirect/000000_lcam_equirect_image.png", 1),
    ("image_lcam_equirect/000001_lcam_equirect_image.png", 2),
    ("image_lcam_equirect/000002_lcam_equirect_image.png", 3),
];

/// Rows of the pose file: translation and quaternion (x, y, z, w) of the front camera's body.
fn pose_rows() -> Vec<String> {
    let row = |number: u8| {
        let (turn, place) = placed(number);
        let (t, q) = (place, DQuat::from_mat3(&turn));
        [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
            .map(|value| format!("{value:.18e}"))
            .join(" ")
    };
    (1..=3).map(row).collect()
}

/// Distances of a frame: rising to the right, the sky in the first row.
fn distances(number: u8) -> Vec<f32> {
    (0..32 * 16)
        .map(|at: u16| match at {
            0..32 => 65_504.0,
            _ => f32::from(number) + 0.1 * f32::from(at % 32) + 0.01 * f32::from(at / 32),
        })
        .collect()
}

/// `cv2.imwrite` of an array of f32 as one of four bytes a pixel, which it takes for blue, green, red, alpha.
fn float_png(values: &[f32]) -> Vec<u8> {
    let bytes = values.iter().flat_map(|value| {
        let [blue, green, red, alpha] = value.to_le_bytes();
        [red, green, blue, alpha]
    });
    let image = image::RgbaImage::from_raw(32, 16, bytes.collect()).unwrap();
    let mut png = Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

fn depth_file(number: u8) -> String {
    format!(
        "depth_lcam_equirect/{:06}_lcam_equirect_depth.png",
        number - 1
    )
}

fn tartanair() -> Foreign {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.write("pose_lcam_front.txt", pose_rows().join("\n") + "\n");
    for number in 1..=3 {
        foreign.write(&depth_file(number), float_png(&distances(number)));
    }
    foreign
}

/// From north, east, down through the axes of the front camera (right, down, forward) to the pixel of a panorama
/// whose front is at three quarters of its width.
fn pixel(number: u8, world: DVec3) -> [f64; 2] {
    let (turn, place) = placed(number);
    let body = turn.transpose() * (world - place);
    let (right, down, forward) = (body.y, body.z, body.x);
    let longitude = right.atan2(forward) + PI / 2.0;
    let latitude = (-down).atan2(right.hypot(forward));
    [
        (longitude / TAU + 0.5).rem_euclid(1.0) * 32.0,
        (0.5 - latitude / PI) * 16.0,
    ]
}

#[test]
fn panoramas_have_the_front_camera_at_three_quarters() {
    let scene = import_as_is(&tartanair(), "tartanair").unwrap();
    for (frame, number) in [1, 2, 3].into_iter().enumerate() {
        assert_sees(&scene, frame, placed(number).1, |world| {
            pixel(number, world)
        });
    }
    // Straight ahead of a camera that looks north.
    let foreign = tartanair();
    foreign.write("pose_lcam_front.txt", "5 6 7 0 0 0 1\n".repeat(3));
    let scene = foreign.import("tartanair").unwrap();
    let pose = scene.frames[0].pose.unwrap();
    let at = |world: DVec3| {
        let local = pose.rotation().unwrap().inverse() * (world - pose.centre());
        CAMERA.project(local).unwrap()
    };
    let (north, west) = (at(dvec3(9.0, 6.0, 7.0)), at(dvec3(5.0, 2.0, 7.0)));
    assert!((north.x - 24.0).abs() < 1e-9 && (north.y - 8.0).abs() < 1e-9);
    assert!((west.x - 16.0).abs() < 1e-9 && (west.y - 8.0).abs() < 1e-9);
    let below = at(dvec3(9.0, 6.0, 11.0));
    assert!((below.x - 24.0).abs() < 1e-9 && (below.y - 12.0).abs() < 1e-9);
}

#[test]
fn times_and_unit_are_those_of_the_data_set() {
    let scene = import_as_is(&tartanair(), "tartanair").unwrap();
    assert_eq!(times(&scene), [0.0, 0.1, 0.2]);
    assert!(notes(&scene, "10 frames per second"));
    assert_eq!(scene.scale, Scale::Metres);
    assert!(scene.published_split.is_none());
}

#[test]
fn distances_come_to_the_bit_and_the_sky_is_unknown() {
    let foreign = tartanair();
    // 1, 0.1 and 65504 as numpy has them in memory, in the order of a PNG.
    let start = float_png(&[1.0, 0.1, 65_504.0].repeat(171)[..512]);
    let png = image::load_from_memory(&start).unwrap().to_rgba8();
    assert_eq!(png.get_pixel(0, 0).0, [0x80, 0x00, 0x00, 0x3f]);
    assert_eq!(png.get_pixel(1, 0).0, [0xcc, 0xcc, 0xcd, 0x3d]);
    assert_eq!(png.get_pixel(2, 0).0, [0x7f, 0xe0, 0x00, 0x47]);

    fs::remove_file(foreign.path().join("in").join(depth_file(3))).unwrap();
    let scene = foreign.import("tartanair").unwrap();
    assert!(scene.frames[2].depth.is_none() && notes(&scene, "frames without distances: 1"));
    for (frame, number) in [1, 2].into_iter().enumerate() {
        let depth = scene.frames[frame].depth.clone().unwrap();
        assert_eq!(depth.unit, 1.0);
        let array = npy::read(&foreign.path().join("out").join(&depth.file)).unwrap();
        assert_eq!(array.shape, [16, 32]);
        let mut expected = distances(number);
        expected[..32].fill(0.0);
        let found: Vec<f32> = array.values.iter().map(|value| *value as f32).collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn poses_belong_to_images_by_their_numbers() {
    let foreign = tartanair();
    fs::remove_file(foreign.path().join("in").join(IMAGES[1].0)).unwrap();
    let scene = import_as_is(&foreign, "tartanair").unwrap();
    assert_eq!(times(&scene), [0.0, 0.2]);
    assert_sees(&scene, 1, placed(3).1, |world| pixel(3, world));
    assert!(notes(&scene, "000001_lcam_equirect_image.png"));
    foreign.paint("image_lcam_front/000000_lcam_front.png", |_, _| [9; 3]);
    let scene = foreign.import("tartanair").unwrap();
    assert!(notes(&scene, "image_lcam_front"));
}

#[test]
fn broken_poses_and_distances_are_refused_by_their_place() {
    let foreign = tartanair();
    let refused = |rows: &[String], what: &str| {
        foreign.write("pose_lcam_front.txt", rows.join("\n"));
        let line = foreign.refusal("tartanair");
        assert!(line.contains("pose_lcam_front.txt"), "{line}");
        assert!(line.contains(what), "{line}");
    };
    let good = pose_rows();
    refused(&good[..2], "2 poses");
    for bad in [
        "nan 0 0 0 0 0 1",
        "0 0 0 nan 0 0 1",
        "1 2 3 0 0 0 0",
        "1 2 3 0 0 0 2",
        "1 2 3 0 0 1",
        "1 2 3 0 0 0 1 0",
        "inf 2 3 0 0 0 1",
        "x 2 3 0 0 0 1",
    ] {
        let rows = [good[0].clone(), bad.to_owned(), good[2].clone()];
        refused(&rows, "line 2");
    }
    foreign.write("pose_lcam_front.txt", good.join("\n"));
    let mut broken = distances(2);
    broken[40] = f32::NAN;
    foreign.write(&depth_file(2), float_png(&broken));
    assert!(foreign.refusal("tartanair").contains("row 1, column 8"));
    foreign.paint(&depth_file(2), |_, _| [7; 3]);
    assert!(foreign.refusal("tartanair").contains("four bytes"));
    fs::remove_dir_all(foreign.path().join("in/image_lcam_equirect")).unwrap();
    assert!(foreign.refusal("tartanair").contains("image_lcam_equirect"));
}
