//! The street of `scripts/fixtures/waymo.py` in the Parquet tables of the Waymo Open Dataset.

use super::*;

const SEGMENT: &str = "10017090168044687777_6380_000_6400_000";

fn truth_of_tables() -> Truth {
    let text = fs::read_to_string(fixture().join("waymo-truth.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn table(component: &str) -> String {
    format!("{component}/{SEGMENT}.parquet")
}

#[test]
fn waymo_comes_with_the_cameras_boxes_points_and_distances_of_the_truth() {
    let (folder, scene) = drive("waymo", "waymo");
    let (folder, truth) = (folder.path(), truth_of_tables());
    assert_cameras(&scene, &truth);
    assert_objects(folder, &scene, &truth);
    for (count, share) in on_boxes(folder, &scene, &truth) {
        assert!(count > 400 && share > 0.9, "{count}, {share}");
    }
    let mut frames = scene.frames.iter();
    let front = frames.find(|frame| frame.image.ends_with("FRONT_000000.png"));
    let (front, car) = (front.unwrap(), &truth.moments[0].boxes[0]);
    assert_box(front.boxes["0"], coloured(folder, front, car));
    assert!(scene.frames.iter().all(|frame| frame.ignore_mask.is_some()));
    for words in [
        "FRONT: the lens",
        "FRONT is resampled",
        "first place of the vehicle, (-20000.000, 35000.000",
        "second returns",
        "0 0-car, 1 1-rider",
        "(2)",
    ] {
        assert!(
            says(&scene, words),
            "{words}: {:?}",
            scene.validation.problems
        );
    }
}

/// Points of both LiDARs lie on the ground, the houses and the parked box, wherever the vehicle was while it turned.
#[test]
fn points_of_waymo_lie_on_the_static_street() {
    let (folder, scene) = drive("waymo", "waymo");
    let truth = truth_of_tables();
    let points = PointCloud::read_ply(&folder.path().join(scene.points.as_ref().unwrap())).unwrap();
    assert!(points.len() > 1000, "{}", points.len());
    // The ground is 1 m below the first place; the houses begin at 8 m to the sides and end at 44 m ahead.
    let parked = &truth.moments[0].boxes[2];
    let apart = |point: &[f64; 3]| {
        let point = DVec3::from_array(*point);
        if parked.holds(point) {
            return 0.0;
        }
        let sides = [point.z + 1.0, point.y - 8.0, point.y + 8.0, point.x - 44.0];
        sides
            .map(f64::abs)
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    };
    let off: Vec<f64> = points.positions.iter().map(apart).collect();
    let far = off.iter().filter(|distance| **distance > 0.02).count();
    assert!(far * 200 < off.len(), "{far} of {}", off.len());
}

#[test]
fn one_camera_of_waymo_keeps_its_resolution_and_loses_its_lens() {
    let (_folder, scene) = drive(&format!("waymo/{SEGMENT}/FRONT"), "waymo");
    assert_eq!(scene.frames.len(), 6);
    assert!(
        scene
            .frames
            .iter()
            .all(|frame| frame.image.ends_with(".png"))
    );
    assert!(scene.frames.iter().all(|frame| frame.ignore_mask.is_none()));
    let Camera::Pinhole(camera) = scene.camera else {
        panic!("drives have pinholes");
    };
    let [fx, _, cx, cy] = truth_of_tables().cameras[0].camera;
    assert_eq!([camera.cx, camera.cy], [cx, cy]);
    assert!((0.8..1.25).contains(&(camera.fx / fx)), "{}", camera.fx);
}

#[test]
fn damaged_tables_of_waymo_are_refused_with_their_place() {
    let paths = [
        "vehicle_pose",
        "camera_calibration",
        "lidar_calibration",
        "camera_image",
        "lidar",
        "lidar_pose",
    ]
    .map(table);
    let [pose, camera, beams, image, lidar, pixels] = paths.each_ref().map(String::as_str);
    let faults: &[Fault<'_>] = &[
        (pose, |_| Vec::new(), ["vehicle_pose", SEGMENT]),
        (camera, |_| Vec::new(), ["camera_calibration", SEGMENT]),
        (beams, |_| Vec::new(), ["lidar_calibration", SEGMENT]),
        (image, halved, ["Parquet", "camera_image"]),
        (lidar, halved, ["Parquet", "lidar"]),
        (
            pose,
            boxes_in_its_place,
            ["[VehiclePoseComponent]", "vehicle_pose"],
        ),
        (pixels, boxes_in_its_place, ["laser_name", "lidar_pose"]),
    ];
    assert_refused("waymo", "waymo", faults);
}

fn halved(bytes: Vec<u8>) -> Vec<u8> {
    bytes[..bytes.len() / 2].to_vec()
}

fn boxes_in_its_place(_: Vec<u8>) -> Vec<u8> {
    fs::read(fixture().join("waymo").join(table("lidar_box"))).unwrap()
}

/// Without poses of pixels, points are where the vehicle was at the begin of the turn, and a line says so.
#[test]
fn tables_that_may_be_missing_are_told() {
    let temp = tempfile::tempdir().unwrap();
    let (folder, out) = (temp.path().join("in"), temp.path().join("out"));
    copy(&fixture().join("waymo"), &folder);
    for component in ["lidar_pose", "lidar_box"] {
        fs::remove_dir_all(folder.join(component)).unwrap();
    }
    let scene = imported(&folder, "waymo", &out).unwrap();
    assert!(scene.points.is_some() && scene.objects.is_empty());
    assert!(says(&scene, "no lidar_pose") && says(&scene, "no lidar_box"));
    fs::remove_dir_all(folder.join("lidar")).unwrap();
    let scene = imported(&folder, "waymo", &temp.path().join("other")).unwrap();
    assert!(scene.points.is_none() && says(&scene, "no lidar: "));
}
