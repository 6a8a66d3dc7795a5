//! Export and import: the same scene comes back, and each format's own axes see the same pixels.

mod cube_faces;
mod datasets;
mod drives;
mod far_points;
mod foreign;
mod lenses;
mod masks;
mod moved;
mod objects;
mod odgs;
mod omniphotos;
mod orders;
mod padding;
mod programs;
mod pycolmap;
mod refusals;
mod roam360;
mod stills;
mod toy;
mod unusual_images;
mod whole_scenes;

use std::{
    f64::consts::{PI, TAU},
    fs,
    path::Path,
};

use glam::{DQuat, DVec3, dvec3};
use omnilife_curate::{
    error::CurateError,
    exchange::{
        ExportRequest, ExportScene, ImportRequest, MaskMeaning, export, import, written_formats,
    },
};
use omnilife_schemas::{
    Pose,
    camera::{CameraModel, ErpCamera, PinholeCamera},
    npy,
    points::PointCloud,
    progress::Silent,
    records::{PoseSource, PoseValidation, Scale, Scene, SceneFrame, ValidationStatus},
    rgb::{self, Mask},
    store,
};
use serde_json::Value;
use tempfile::TempDir;

const CAMERA: ErpCamera = ErpCamera::new(32, 16);

/// Six frames on a bent path; the second has no mask, the last no pose.
fn scene() -> (TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for name in ["frames", "masks"] {
        fs::create_dir(root.join(name)).unwrap();
    }
    let frames = (0..6).map(|index| {
        let t = f64::from(index);
        let image = format!("frames/{index:06}.png");
        let pixels: Vec<u8> = (0..32 * 16 * 3)
            .map(|at| (at * (index + 3) % 251) as u8)
            .collect();
        rgb::write_rgb8_png(&root.join(&image), 32, 16, &pixels).unwrap();
        let mask = (index != 1).then(|| {
            let data = (0..32 * 16)
                .map(|at| if at % (index + 2) == 0 { 255 } else { 0 })
                .collect();
            let name = format!("masks/{index:06}.png");
            Mask::new(32, 16, data)
                .write_png(&root.join(&name))
                .unwrap();
            name
        });
        let q = DQuat::from_euler(glam::EulerRot::YXZ, 0.9 * t, 0.2 * t - 0.4, 0.1 * t);
        SceneFrame {
            image,
            // Unsteady, and not from 0.
            time_seconds: 3.0 + 0.04 * t + 0.001 * t * t,
            pose: (index != 5).then(|| {
                let centre = dvec3(0.3 * t, -0.7 + 0.05 * t * t, 1.0 / (1.0 + t));
                Pose::new(q, centre)
            }),
            mask,
            ignore_mask: (index == 1 || index == 2).then(|| holder(root, index)),
            classes: [].into(),
            objects: [].into(),
            boxes: [].into(),
            depth: None,
            depth_prior: None,
            capture: None,
        }
    });
    let scene = Scene {
        points: Some("points.ply".to_owned()),
        ..Scene::given("clip/seq-000", CAMERA, frames.collect())
    };
    let points = PointCloud {
        positions: vec![[0.1, -2.5, 3.0e-3], [1.0e3, 4.0, -7.25]],
        colours: vec![[1, 2, 3], [250, 128, 0]],
    };
    points.write_ply(&root.join("points.ply")).unwrap();
    store::write_record(&root.join("scene.json"), &scene).unwrap();
    (folder, scene)
}

/// The mask of whoever holds the camera in a frame, its file.
fn holder(root: &Path, index: i32) -> String {
    let name = format!("ignore/{index:06}.png");
    fs::create_dir_all(root.join("ignore")).unwrap();
    let data = (0..32 * 16).map(|at| 255 * u8::from(at % 32 > 20 + index));
    Mask::new(32, 16, data.collect())
        .write_png(&root.join(&name))
        .unwrap();
    name
}

/// Exports without a split.
fn export_all(format: &str, scene_folder: &Path, out: &Path) -> Result<ExportScene, CurateError> {
    let request = ExportRequest::new(scene_folder, format, out);
    export(&request, &Silent)
}

fn exported(format: &str, scene_folder: &Path) -> TempDir {
    let out = tempfile::tempdir().unwrap();
    export_all(format, scene_folder, &out.path().join("scene")).unwrap();
    out
}

/// Exports a scene and imports it again, into the folder `back` beside the export.
fn round_trip(format: &str, scene_folder: &Path, id: &str) -> (TempDir, Scene) {
    let export = exported(format, scene_folder);
    let scene = import(&ImportRequest::new(
        &export.path().join("scene"),
        format,
        id,
        &export.path().join("back"),
    ))
    .unwrap();
    (export, scene)
}

/// The summary of an export and its table of times are of its files.
#[test]
fn hm3d_has_numbered_images_and_no_points() {
    let (folder, _) = scene();
    let out = folder.path().join("out");
    let written = export_all("hm3d", folder.path(), &out).unwrap();
    assert!(written.points.is_empty());
    let times = fs::read_to_string(out.join("times.csv")).unwrap();
    let named: Vec<&str> = times
        .lines()
        .skip(1)
        .map(|row| row.split(',').next().unwrap())
        .collect();
    assert_eq!(named.len(), written.frames.len());
    for name in named {
        assert!(out.join("pano").join(name).is_file(), "{name}");
    }
}

#[test]
fn every_format_gives_back_what_it_was_given() {
    let (folder, original) = scene();
    for format in written_formats() {
        let (export, imported) = round_trip(format.id, folder.path(), &original.id);
        let back = export.path().join("back");
        let posed = &original.frames[..5];
        // One alone holds frames without a pose.
        let unposed = usize::from(format.id == "frames");
        assert_eq!(imported.frames.len(), 5 + unposed, "{}", format.id);
        assert_eq!(imported.camera, CAMERA.into());
        if let PoseSource::Given { file } = &imported.pose_source {
            assert!(!file.contains('/'), "{}: {file}", format.id);
        }
        for (frame, expected) in imported.frames.iter().zip(posed) {
            assert_eq!(frame.time_seconds, expected.time_seconds, "{}", format.id);
            let (pose, truth) = (frame.pose.unwrap(), expected.pose.unwrap());
            let turn = pose
                .rotation()
                .unwrap()
                .angle_between(truth.rotation().unwrap());
            assert!(turn < 1e-6, "{}: {turn} radians", format.id);
            assert!(
                pose.centre().distance(truth.centre()) < 1e-6,
                "{}",
                format.id
            );
            let pixels = |root: &Path, file: &str| image::open(root.join(file)).unwrap();
            assert_eq!(
                pixels(&back, &frame.image),
                pixels(folder.path(), &expected.image)
            );
            let ignored = |root: &Path, file: &Option<String>| {
                file.as_ref()
                    .map(|file| Mask::read(&root.join(file)).unwrap())
            };
            assert_eq!(
                ignored(&back, &frame.ignore_mask),
                ignored(folder.path(), &expected.ignore_mask),
                "{}",
                format.id
            );
            assert_eq!(
                frame.mask.is_some(),
                expected.mask.is_some(),
                "{}",
                format.id
            );
            if let (Some(mask), Some(truth)) = (&frame.mask, &expected.mask) {
                let mut truth = Mask::read(&folder.path().join(truth)).unwrap();
                let has_both_kinds = !["hm3d", "frames"].contains(&format.id);
                if let Some(ignored) = expected.ignore_mask.as_ref().filter(|_| has_both_kinds) {
                    truth = truth.without(&Mask::read(&folder.path().join(ignored)).unwrap());
                }
                assert_eq!(
                    Mask::read(&back.join(mask)).unwrap(),
                    truth,
                    "{}",
                    format.id
                );
            }
        }
        let points = imported
            .points
            .map(|file| PointCloud::read_ply(&back.join(file)).unwrap());
        let expected = PointCloud::read_ply(&folder.path().join("points.ply")).unwrap();
        // The only format that holds none.
        assert_eq!(
            points,
            (format.id != "hm3d").then_some(expected),
            "{}",
            format.id
        );
        let read: Scene = store::read_record(&back.join("scene.json")).unwrap();
        assert_eq!(read.frames, imported.frames);
    }
}

/// The camera of a pinhole comes back as well, from the formats that know one.
#[test]
fn pinhole_cameras_come_back() {
    let (folder, mut original) = scene();
    let pinhole = PinholeCamera::new([32, 16], [21.25, 21.25], [15.5, 8.125]);
    let path = folder.path().join("scene.json");
    original.camera = pinhole.into();
    store::write_record(&path, &original).unwrap();
    for format in ["colmap", "nerfstudio", "openmvg"] {
        let export = exported(format, folder.path());
        let imported = import(&ImportRequest::new(
            &export.path().join("scene"),
            format,
            &original.id,
            &export.path().join("back"),
        ));
        assert_eq!(imported.unwrap().camera, pinhole.into(), "{format}");
    }
    let refused = |format: &str| {
        let out = tempfile::tempdir().unwrap();
        let out = out.path().join("scene");
        let outcome = export_all(format, folder.path(), &out);
        assert!(!out.exists(), "{format}");
        outcome.map(drop).unwrap_err().to_string()
    };
    assert!(refused("hm3d").contains("pinhole"));
    original.camera = PinholeCamera {
        fy: 22.0,
        ..pinhole
    }
    .into();
    store::write_record(&path, &original).unwrap();
    assert!(refused("openmvg").contains("one focal length"));
}

/// cereal writes the size of a spherical camera inside of its base class, and OpenMVG views and poses
/// into one file.
#[test]
fn openmvgs_own_file_is_read() {
    let (folder, original) = scene();
    let export = exported("openmvg", folder.path());
    let at = |name: &str| export.path().join("scene").join(name);
    let (mut whole, poses) = (
        json(&at("data_views.json")),
        json(&at("data_extrinsics.json")),
    );
    let size = &whole["intrinsics"][0]["value"]["ptr_wrapper"]["data"]["value0"];
    assert_eq!([&size["width"], &size["height"]], [32, 16]);
    whole["extrinsics"] = poses["extrinsics"].clone();
    fs::write(at("sfm_data.json"), whole.to_string()).unwrap();
    fs::remove_file(at("data_views.json")).unwrap();
    fs::remove_file(at("data_extrinsics.json")).unwrap();
    let imported = import(&ImportRequest::new(
        &export.path().join("scene"),
        "openmvg",
        &original.id,
        &export.path().join("back"),
    ))
    .unwrap();
    assert_eq!(imported.camera, original.camera);
    assert_eq!(imported.validation.registered_frames, 5);
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn vector(value: &Value) -> DVec3 {
    let [x, y, z] = [0, 1, 2].map(|index| value[index].as_f64().unwrap());
    dvec3(x, y, z)
}

/// Column and row of a world point in frame 3, by the format's own rules, from its own files.
fn seen_by(format: &str, folder: &Path, world: DVec3) -> (f64, f64) {
    let (width, height) = (f64::from(CAMERA.width), f64::from(CAMERA.height));
    match format {
        "openmvg" => {
            let pose = &json(&folder.join("data_extrinsics.json"))["extrinsics"][3]["value"];
            let offset = world - vector(&pose["center"]);
            let p = dvec3(
                vector(&pose["rotation"][0]).dot(offset),
                vector(&pose["rotation"][1]).dot(offset),
                vector(&pose["rotation"][2]).dot(offset),
            );
            // Camera_Spherical::project: lon = atan2(x, z), lat = atan2(-y, hypot(x, z)).
            let (lon, lat) = (p.x.atan2(p.z), (-p.y).atan2(p.x.hypot(p.z)));
            (
                width * (lon / TAU + 0.5),
                width * (-lat / TAU) + height / 2.0,
            )
        }
        "colmap" => {
            let text = fs::read_to_string(folder.join("sparse/0/images.txt")).unwrap();
            let line = text.lines().nth(6).unwrap();
            assert!(line.ends_with("000003.png"), "{line}");
            let n: Vec<f64> = line
                .split(' ')
                .skip(1)
                .take(7)
                .map(|w| w.parse().unwrap())
                .collect();
            let p = DQuat::from_xyzw(n[1], n[2], n[3], n[0]) * world + dvec3(n[4], n[5], n[6]);
            // EquirectangularCameraModel::ImgFromCam.
            let (lon, lat) = (p.x.atan2(p.z), (-p.y / p.length()).asin());
            (width * (lon / TAU + 0.5), height * (0.5 - lat / PI))
        }
        "colmap-binary" => {
            let bytes = fs::read(folder.join("sparse/0/images.bin")).unwrap();
            // A count, then records of id, pose, camera, name with its zero, and no features.
            let record = 4 + 7 * 8 + 4 + "000000.png".len() + 1 + 8;
            let pose = &bytes[8 + 3 * record + 4..][..56];
            assert_eq!(&bytes[8 + 3 * record + 64..][..10], b"000003.png");
            let n: Vec<f64> = pose
                .chunks(8)
                .map(|chunk| f64::from_le_bytes(chunk.try_into().unwrap()))
                .collect();
            let p = DQuat::from_xyzw(n[1], n[2], n[3], n[0]) * world + dvec3(n[4], n[5], n[6]);
            let (lon, lat) = (p.x.atan2(p.z), (-p.y / p.length()).asin());
            (width * (lon / TAU + 0.5), height * (0.5 - lat / PI))
        }
        "nerfstudio" => {
            let transforms = json(&folder.join("transforms.json"));
            let rows = &transforms["frames"][3]["transform_matrix"];
            let column = |c: usize| {
                let [x, y, z] = [0, 1, 2].map(|row: usize| rows[row][c].as_f64().unwrap());
                dvec3(x, y, z)
            };
            let offset = world - column(3);
            let p = dvec3(
                column(0).dot(offset),
                column(1).dot(offset),
                column(2).dot(offset),
            );
            // Cameras._generate_rays_from_coords inverted: theta = -pi x, phi = pi (1/2 - y),
            // direction (-sin theta sin phi, cos phi, -cos theta sin phi).
            let p = p.normalize();
            let (theta, phi) = ((-p.x).atan2(-p.z), p.y.acos());
            let focal = transforms["fl_x"].as_f64().unwrap();
            let centre = |key: &str| transforms[key].as_f64().unwrap();
            (
                -theta / PI * focal + centre("cx"),
                centre("cy") - (0.5 - phi / PI) * centre("fl_y"),
            )
        }
        "hm3d" => {
            let rotation = npy::read(&folder.join("rotation.npy")).unwrap();
            let translation = npy::read(&folder.join("translation.npy")).unwrap();
            let offset = world - DVec3::from_slice(&translation.values[9..12]);
            let column = |c: usize| {
                let at = |row: usize| rotation.values[27 + 3 * row + c];
                dvec3(at(0), at(1), at(2))
            };
            let p = dvec3(
                column(0).dot(offset),
                column(1).dot(offset),
                column(2).dot(offset),
            );
            // warp_pano: theta = atan2(x, z), u = (1/2 - theta / 2 pi) W.
            let (theta, phi) = (p.x.atan2(p.z), p.y.atan2(p.x.hypot(p.z)));
            (width * (0.5 - theta / TAU), height * (0.5 - phi / PI))
        }
        "frames" => {
            let pose = &json(&folder.join("poses.json"))["frames"][3]["pose"];
            let q = &pose["rotation_wxyz"];
            let [w, x, y, z] = [0, 1, 2, 3].map(|index| q[index].as_f64().unwrap());
            let rotation = DQuat::from_xyzw(x, y, z, w);
            let p = rotation.inverse() * (world - vector(&pose["centre"]));
            let (lon, lat) = (p.x.atan2(p.z), (-p.y).atan2(p.x.hypot(p.z)));
            (width * (lon / TAU + 0.5), height * (0.5 - lat / PI))
        }
        other => panic!("{other} has no rules here"),
    }
}

#[test]
fn every_format_sees_the_same_pixel_by_its_own_rules() {
    let (folder, original) = scene();
    let pose = original.frames[3].pose.unwrap();
    for format in written_formats() {
        let export = exported(format.id, folder.path());
        for direction in [
            dvec3(1.0, 0.2, 0.1),
            dvec3(-0.3, -0.9, 0.4),
            dvec3(0.1, 0.5, -2.0),
        ] {
            let world = pose.centre() + 3.0 * direction;
            let camera = pose.rotation().unwrap().inverse() * (world - pose.centre());
            let expected = CAMERA.project(camera).unwrap();
            let (u, v) = seen_by(format.id, &export.path().join("scene"), world);
            let across = CAMERA.wrapped_column_distance(u, expected.x);
            assert!(
                across.abs() < 1e-4 && (v - expected.y).abs() < 1e-4,
                "{}: {u}, {v}, expected {expected}",
                format.id
            );
        }
    }
}

#[test]
fn numpy_reads_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    npy::write_f32(&path, &[2, 3], &[1.0, -2.5, 3.0, 4.0, 5.0, 6.0]).unwrap();
    let bytes = fs::read(&path).unwrap();
    // As numpy 1.26 writes it: np.save("a.npy", np.array([[1, -2.5, 3], [4, 5, 6]], np.float32)).
    let header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
    assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
    assert_eq!(&bytes[10..10 + header.len()], header);
    assert_eq!(bytes.len(), 128 + 24);
    let array = npy::read(&path).unwrap();
    assert_eq!(array.shape, [2, 3]);
    assert_eq!(array.values, [1.0, -2.5, 3.0, 4.0, 5.0, 6.0]);
    fs::write(&path, &bytes[..140]).unwrap();
    assert!(npy::read(&path).is_err());
}
