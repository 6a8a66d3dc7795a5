//! Drives: the rendered street of `scripts/fixtures/drive.py` in all layouts, compared with its truth.

mod waymo;

use std::path::PathBuf;

use glam::{DMat3, DVec2, dvec2};
use omnilife_schemas::{
    RgbImage,
    camera::Camera,
    distances::DistanceImage,
    records::{DistanceConvention, ObjectClass, Tracks},
};
use serde::Deserialize;

use super::*;

/// Difference of channels up to which a pixel has the colour of a box, of 255.
const SAME_COLOUR: f64 = 40.0;

#[derive(Deserialize)]
struct Truth {
    cameras: Vec<TrueCamera>,
    moments: Vec<Moment>,
}

#[derive(Deserialize)]
struct TrueCamera {
    image: String,
    centre: DVec3,
    to_world: [[f64; 3]; 3],
    camera: [f64; 4],
    seconds: f64,
}

#[derive(Deserialize)]
struct Moment {
    seconds: f64,
    boxes: Vec<TrueBox>,
}

#[derive(Deserialize)]
struct TrueBox {
    object: u32,
    colour: [f64; 3],
    sides: DVec3,
    centre: DVec3,
    heading: f64,
}

impl TrueBox {
    /// True where a point is in the box that is larger by 2 cm.
    fn holds(&self, point: DVec3) -> bool {
        let own = DMat3::from_rotation_z(-self.heading) * (point - self.centre);
        own.abs().cmple(0.5 * self.sides + 0.02).all()
    }

    fn has_colour(&self, pixel: [f64; 3], tolerance: f64) -> bool {
        let mut channels = pixel.iter().zip(self.colour);
        channels.all(|(found, expected)| (found - expected).abs() <= tolerance)
    }
}

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/drive")
}

fn truth(layout: &str) -> Truth {
    let text = fs::read_to_string(fixture().join("truth.json")).unwrap();
    let mut all: Value = serde_json::from_str(&text).unwrap();
    serde_json::from_value(all[layout].take()).unwrap()
}

fn imported(folder: &Path, format: &str, out: &Path) -> Result<Scene, CurateError> {
    import(&ImportRequest {
        folder,
        format,
        id: "drive",
        frames_per_second: None,
        masks: MaskMeaning::Moving,
        out,
    })
}

/// A scene of the fixture with its folder.
fn drive(path: &str, format: &str) -> (TempDir, Scene) {
    let out = tempfile::tempdir().unwrap();
    let scene = imported(&fixture().join(path), format, out.path()).unwrap();
    (out, scene)
}

/// Cameras are where the truth has them, look where they do, and have its times.
fn assert_cameras(scene: &Scene, truth: &Truth) {
    assert_eq!(scene.scale, Scale::Metres);
    assert_eq!(scene.frames.len(), truth.cameras.len());
    for camera in &truth.cameras {
        let name = format!("frames/{}", camera.image);
        let frame = scene.frames.iter().find(|frame| frame.image == name);
        let frame = frame.unwrap_or_else(|| panic!("{name} is missing"));
        let pose = frame.pose.unwrap();
        assert!(pose.centre().distance(camera.centre) < 1e-6, "{name}");
        let to_world = DMat3::from_cols_array_2d(&camera.to_world).transpose();
        let found = DMat3::from_quat(pose.rotation().unwrap());
        for (found, expected) in [
            (found.x_axis, to_world.x_axis),
            (found.y_axis, to_world.y_axis),
            (found.z_axis, to_world.z_axis),
        ] {
            assert!(found.distance(expected) < 1e-6, "{name}");
        }
        assert!((frame.time_seconds - camera.seconds).abs() < 1e-6, "{name}");
    }
}

/// Tracks have the boxes of the two moving objects, and the scene their classes and nothing of the parked one.
fn assert_objects(folder: &Path, scene: &Scene, truth: &Truth) -> Tracks {
    let classes: Vec<(&str, ObjectClass)> = (scene.objects.iter())
        .map(|(name, object)| (name.as_str(), object.class))
        .collect();
    let expected = [("0", ObjectClass::Vehicle), ("1", ObjectClass::Person)];
    assert_eq!(classes, expected);
    let tracks = Tracks::beside_split("drive", folder).unwrap().unwrap();
    assert!(tracks.are_labels());
    assert_eq!(
        tracks.tracks.iter().map(|one| one.id).collect::<Vec<_>>(),
        [0, 1]
    );
    assert_eq!(tracks.frames.len(), scene.frames.len());
    for moment in &truth.moments {
        for expected in moment.boxes.iter().filter(|one| one.object < 2) {
            let track = &tracks.tracks[expected.object as usize];
            let (centre, heading) = track.path.at(moment.seconds).unwrap();
            assert!(centre.distance(expected.centre) < 1e-5, "{centre}");
            // The vehicle of KITTI is tilted by 0.3 degrees, of which its labels know nothing.
            assert!((heading - expected.heading).abs() < 0.01, "{heading}");
            let sides = DVec3::from_array(track.dimensions);
            assert!(sides.distance(expected.sides) < 1e-6, "{sides}");
        }
    }
    for detection in &tracks.detections {
        let name = detection.track.unwrap().to_string();
        let frame = &scene.frames[detection.frame as usize];
        assert_eq!(frame.boxes[&name], detection.box_pixels);
    }
    tracks
}

fn pixel(image: &RgbImage, at: usize) -> [f64; 3] {
    [0, 1, 2].map(|channel| 255.0 * f64::from(image.data[3 * at + channel]))
}

/// The distances of the LiDAR, lifted by the poses of the scene, lie on boxes where the images show their colours.
/// Returns the number on the car and the cyclist, and the share with their colour.
fn on_boxes(folder: &Path, scene: &Scene, truth: &Truth) -> [(usize, f64); 2] {
    let mut counts = [[0_usize; 2]; 2];
    for frame in &scene.frames {
        let prior = frame.depth_prior.as_ref().unwrap();
        assert_eq!(prior.convention, DistanceConvention::Ray);
        assert_eq!(
            (prior.width, prior.height),
            (scene.camera.width(), scene.camera.height())
        );
        let distances = DistanceImage::read(&folder.join(&prior.file), prior.unit, false).unwrap();
        let image = RgbImage::read(&folder.join(&frame.image)).unwrap();
        let pose = frame.pose.unwrap();
        // Sweeps are taken at the moments.
        let apart = |moment: &&Moment| (moment.seconds - frame.time_seconds).abs();
        let moment = (truth.moments.iter())
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
            .unwrap();
        for (at, &distance) in distances.values.iter().enumerate() {
            if distance == 0.0 {
                continue;
            }
            let place = dvec2((at % image.width) as f64, (at / image.width) as f64) + 0.5;
            let ray = pose.rotation().unwrap() * scene.camera.unproject(place);
            let point = pose.centre() + f64::from(distance) * ray;
            for one in moment
                .boxes
                .iter()
                .filter(|one| one.object < 2 && one.holds(point))
            {
                let count = &mut counts[one.object as usize];
                count[0] += 1;
                count[1] += usize::from(one.has_colour(pixel(&image, at), SAME_COLOUR));
            }
        }
    }
    counts.map(|[all, same]| (all, same as f64 / all.max(1) as f64))
}

/// Box of the pixels that have the colour of an object.
fn coloured(folder: &Path, frame: &SceneFrame, object: &TrueBox) -> [f64; 4] {
    let image = RgbImage::read(&folder.join(&frame.image)).unwrap();
    let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for at in 0..image.width * image.height {
        if object.has_colour(pixel(&image, at), SAME_COLOUR) {
            let corner = dvec2((at % image.width) as f64, (at / image.width) as f64);
            (least, greatest) = (least.min(corner), greatest.max(corner + 1.0));
        }
    }
    [least.x, least.y, greatest.x - least.x, greatest.y - least.y]
}

fn assert_box(found: [f64; 4], shown: [f64; 4]) {
    for (found, shown) in found.iter().zip(shown) {
        assert!((found - shown).abs() < 2.0, "{found}, in the image {shown}");
    }
}

fn says(scene: &Scene, words: &str) -> bool {
    let mut lines = scene.validation.problems.iter();
    lines.any(|line| line.contains(words))
}

#[test]
fn kitti_tracking_comes_with_the_cameras_boxes_points_and_distances_of_the_truth() {
    let (folder, scene) = drive("kitti", "kitti-tracking");
    let (folder, truth) = (folder.path(), truth("kitti"));
    assert_cameras(&scene, &truth);
    let [fx, fy, cx, cy] = truth.cameras[0].camera;
    let expected = PinholeCamera {
        width: 96,
        height: 64,
        fx,
        fy,
        cx,
        cy,
    };
    assert_eq!(scene.camera, Camera::Pinhole(expected));
    assert_objects(folder, &scene, &truth);
    for (count, share) in on_boxes(folder, &scene, &truth) {
        assert!(count > 400 && share > 0.95, "{count}, {share}");
    }
    // At first nothing hides the car.
    let first = &scene.frames[0];
    let car = &truth.moments[0].boxes[0];
    assert_box(first.boxes["0"], coloured(folder, first, car));
    assert!(first.ignore_mask.is_none());
    let points = PointCloud::read_ply(&folder.join(scene.points.as_ref().unwrap())).unwrap();
    assert!(points.len() > 1000, "{}", points.len());
    let moving = &truth.moments[0].boxes[..2];
    let of_moving = points.colours.iter().filter(|colour| {
        let colour = colour.map(f64::from);
        moving.iter().any(|one| one.has_colour(colour, 10.0))
    });
    // Some are beside a box within the same pixel.
    assert!(of_moving.count() * 100 < points.len());
    for words in [
        "DontCare",
        "reflectance",
        "in boxes of moving objects",
        "(2)",
        "10 frames per second",
    ] {
        assert!(
            says(&scene, words),
            "{words}: {:?}",
            scene.validation.problems
        );
    }
}

#[test]
fn nuscenes_comes_with_the_cameras_boxes_points_and_distances_of_the_truth() {
    let (folder, scene) = drive("nuscenes", "nuscenes");
    let (folder, truth) = (folder.path(), truth("nuscenes"));
    assert_cameras(&scene, &truth);
    assert_objects(folder, &scene, &truth);
    for (count, share) in on_boxes(folder, &scene, &truth) {
        assert!(count > 400 && share > 0.9, "{count}, {share}");
    }
    let front = scene
        .frames
        .iter()
        .find(|frame| frame.image.contains("CAM_FRONT_drive"));
    let (front, car) = (front.unwrap(), &truth.moments[0].boxes[0]);
    assert_box(front.boxes["0"], coloured(folder, front, car));
    // What a camera does not show of the common image is not part of the scene.
    assert!(scene.frames.iter().all(|frame| frame.ignore_mask.is_some()));
    for words in ["CAM_FRONT_LEFT is resampled", "between key frames", "(2)"] {
        assert!(
            says(&scene, words),
            "{words}: {:?}",
            scene.validation.problems
        );
    }
}

#[test]
fn a_path_names_the_sequence_and_the_cameras() {
    let (_folder, scene) = drive("kitti/0003/image_03", "kitti-tracking");
    assert_eq!(scene.frames.len(), 6);
    assert!(scene.frames[0].image.contains("image_03"));
    let temp = tempfile::tempdir().unwrap();
    let (folder, out) = (temp.path().join("in"), temp.path().join("out"));
    copy(&fixture().join("kitti"), &folder);
    fs::remove_dir_all(folder.join("image_03/0003")).unwrap();
    assert!(says(
        &imported(&folder, "kitti-tracking", &out).unwrap(),
        "no image_03"
    ));
    // One camera alone keeps its own.
    let (_folder, scene) = drive("nuscenes/scene-0061/CAM_FRONT", "nuscenes");
    let Camera::Pinhole(camera) = scene.camera else {
        panic!("drives have pinholes");
    };
    assert_eq!(
        [camera.fx, camera.fy, camera.cx, camera.cy],
        [80.0, 82.0, 46.5, 31.5]
    );
    assert!(scene.frames.iter().all(|frame| frame.ignore_mask.is_none()));
    for (path, format, told) in [
        ("kitti/0003/image_07", "kitti-tracking", "image_07"),
        ("kitti/0004", "kitti-tracking", "0004"),
        ("nuscenes/scene-0061/CAM_TOP", "nuscenes", "CAM_TOP"),
        ("nuscenes", "kitti-tracking", "calib/"),
        ("kitti", "nuscenes", "v1.0-"),
        ("kitti", "waymo", "camera_image/"),
    ] {
        let out = tempfile::tempdir().unwrap();
        let found = imported(&fixture().join(path), format, &out.path().join("out"));
        let line = found.unwrap_err().to_string();
        assert!(line.contains(told) && !line.contains('\n'), "{line}");
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy(&from, &to);
        } else {
            fs::copy(from, to).unwrap();
        }
    }
}

/// A change of a file of a layout, and words of the error: what must hold, and the file.
type Fault<'a> = (&'a str, fn(Vec<u8>) -> Vec<u8>, [&'static str; 2]);

fn replaced(bytes: Vec<u8>, from: &str, to: &str) -> Vec<u8> {
    let text = String::from_utf8(bytes).unwrap();
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1).into_bytes()
}

fn cut(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.pop();
    bytes
}

/// The second number becomes NaN.
fn with_nan(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
    bytes
}

fn assert_refused(layout: &str, format: &str, faults: &[Fault<'_>]) {
    for (file, change, told) in faults {
        let temp = tempfile::tempdir().unwrap();
        let (folder, out) = (temp.path().join("in"), temp.path().join("out"));
        copy(&fixture().join(layout), &folder);
        let bytes = change(fs::read(folder.join(file)).unwrap());
        if bytes.is_empty() {
            fs::remove_file(folder.join(file)).unwrap();
        } else {
            fs::write(folder.join(file), bytes).unwrap();
        }
        let found = imported(&folder, format, &out);
        let line = found.map(|scene| scene.id).unwrap_err().to_string();
        for words in told {
            assert!(
                line.contains(*words) && !line.contains('\n'),
                "{file}: {line}"
            );
        }
        assert!(!out.exists(), "{file}");
    }
}

#[test]
fn damaged_files_of_kitti_are_refused_with_their_place() {
    let faults: &[Fault<'_>] = &[
        (
            "calib/0003.txt",
            |bytes| replaced(bytes, "Tr_velo_cam", "Tr_x"),
            ["Tr_velo_cam", "0003.txt"],
        ),
        (
            "calib/0003.txt",
            |bytes| replaced(bytes, "P2: ", "P2: 1 "),
            ["got 13", "calib"],
        ),
        ("oxts/0003.txt", |_| Vec::new(), ["oxts", "0003.txt"]),
        (
            "oxts/0003.txt",
            |bytes| replaced(bytes, " 0 0\n", " 0\n"),
            ["got 29", "oxts"],
        ),
        (
            "label_02/0003.txt",
            |bytes| replaced(bytes, "0 0 Car 0", "0 0 Car"),
            ["got 16", "label_02"],
        ),
        (
            "label_02/0003.txt",
            |bytes| replaced(bytes, "0 0 Car 0 0", "0 0 Car nan 0"),
            ["nan", "line 1"],
        ),
        (
            "label_02/0003.txt",
            |bytes| replaced(bytes, "0 0 Car", "3 0 Car"),
            ["must rise", "label_02"],
        ),
        ("velodyne/0003/000002.bin", cut, ["16 bytes", "000002.bin"]),
        (
            "velodyne/0003/000002.bin",
            with_nan,
            ["must be finite", "000002.bin"],
        ),
    ];
    assert_refused("kitti", "kitti-tracking", faults);
}

#[test]
fn damaged_files_of_nuscenes_are_refused_with_their_place() {
    const TABLES: [&str; 4] = [
        "v1.0-mini/sample.json",
        "v1.0-mini/ego_pose.json",
        "v1.0-mini/calibrated_sensor.json",
        "v1.0-mini/sample_annotation.json",
    ];
    let [sample, ego, sensor, annotation] = TABLES;
    let faults: &[Fault<'_>] = &[
        (
            sample,
            |bytes| replaced(bytes, "1532402927500000", "1532402926500000"),
            ["must rise", "sample.json"],
        ),
        (
            sample,
            |bytes| replaced(bytes, "\"next\": \"sample-1\"", "\"next\": \"x\""),
            ["\"x\"", "sample.json"],
        ),
        (
            ego,
            |bytes| replaced(bytes, "\"rotation\": [0", "\"rotation\": [7"),
            ["unit quaternion", "ego_pose.json"],
        ),
        (ego, |_| Vec::new(), ["ego_pose.json", "v1.0-mini"]),
        (
            sensor,
            |bytes| replaced(bytes, "[0.0, 0.0, 1.0]", "[0.0, 0.0]"),
            ["3x3", "calibrated_sensor.json"],
        ),
        (
            sensor,
            |bytes| replaced(bytes, "c-CAM_FRONT\"", "c-x\""),
            ["c-CAM_FRONT", "calibrated_sensor.json"],
        ),
        (
            annotation,
            |bytes| replaced(bytes, "\"size\": [1.8", "\"size\": [-1.8"),
            ["above 0", "annotation.json"],
        ),
        (
            "samples/LIDAR_TOP/drive__LIDAR_TOP__1532402927500000.pcd.bin",
            cut,
            ["20 bytes", ".pcd.bin"],
        ),
        (
            "samples/LIDAR_TOP/drive__LIDAR_TOP__1532402927500000.pcd.bin",
            with_nan,
            ["finite", ".pcd.bin"],
        ),
    ];
    assert_refused("nuscenes", "nuscenes", faults);
}

#[test]
fn a_frame_rate_is_refused_where_the_layout_has_times() {
    let out = tempfile::tempdir().unwrap();
    let found = import(&ImportRequest {
        folder: &fixture().join("kitti"),
        format: "kitti-tracking",
        id: "drive",
        frames_per_second: Some(10.0),
        masks: MaskMeaning::Moving,
        out: &out.path().join("out"),
    });
    assert!(
        found
            .unwrap_err()
            .to_string()
            .contains("--fps must be left out")
    );
}
