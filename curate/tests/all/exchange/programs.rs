//! Files as other programs write them.

use serde_json::json;

use super::{
    foreign::{
        Foreign, assert_poses, notes, pose, transform_matrix, write_colmap_binary,
        write_colmap_text,
    },
    *,
};

const SIZE: [u32; 2] = [32, 16];
const IMAGES: [(&str, u8); 3] = [
    ("images/frame_00001.png", 1),
    ("images/frame_00002.png", 2),
    ("images/frame_00003.png", 3),
];
const BYTE_ORDER_MARK: &str = "\u{feff}";

/// A file of `ns-process-data`: its frames, each with these entries, beside those of the file.
fn ns_process_data(file: &Value, of_frames: &Value) -> Value {
    let mut transforms = file.clone();
    let frames: Vec<Value> = (IMAGES.iter().rev())
        .map(|(name, number)| {
            let mut frame = of_frames.clone();
            frame["file_path"] = json!(format!("./{name}"));
            frame["transform_matrix"] = transform_matrix(*number);
            frame["colmap_im_id"] = json!(40 - number);
            frame
        })
        .collect();
    transforms["frames"] = json!(frames);
    transforms["applied_transform"] = json!([
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [-0.0, -1.0, -0.0, -0.0]
    ]);
    transforms["applied_scale"] = json!(0.5);
    transforms["ply_file_path"] = json!("sparse_pc.ply");
    transforms
}

const SPARSE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                             property float z\nproperty uint8 red\nproperty uint8 green\n\
                             property uint8 blue\nend_header\n1.500000 -2.250000 0.125000 9 8 7\n";

#[test]
fn transforms_of_ns_process_data_are_read_as_they_are() {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.write("sparse_pc.ply", SPARSE_POINTS);
    let metashape = json!({"w": 32, "h": 16, "fl_x": 16.0, "fl_y": 16, "cx": 16.0, "cy": 8.0});
    let no_calibration = json!({"w": 32.0, "h": 16.0});
    let model = json!({"camera_model": "EQUIRECTANGULAR"});
    let whole = json!({"camera_model": "EQUIRECTANGULAR", "w": 32, "h": 16});
    let nothing = json!({});
    for (file, of_frames) in [
        (&model, &metashape),
        (&model, &no_calibration),
        (&whole, &nothing),
        (&whole, &whole),
    ] {
        let text = ns_process_data(file, of_frames).to_string();
        foreign.write("transforms.json", format!("{BYTE_ORDER_MARK}{text}"));
        let scene = foreign.import("nerfstudio").unwrap();
        assert_eq!(scene.camera, CAMERA.into());
        assert_poses(&scene, &[1, 2, 3]);
        assert_eq!(foreign.shown(&scene), [(1, 0), (2, 10), (3, 20)]);
        let cloud = PointCloud::read_ply(&foreign.path().join("out/points.ply")).unwrap();
        assert_eq!(cloud.positions, [[1.5, -2.25, 0.125]]);
    }
}

#[test]
fn entries_that_speak_of_a_camera_are_known_or_refused() {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.write("sparse_pc.ply", SPARSE_POINTS);
    let sphere = json!({"camera_model": "EQUIRECTANGULAR", "w": 32, "h": 16});
    let with = |base: &Value, entry: &str, value: Value| {
        let mut changed = base.clone();
        changed[entry] = value;
        changed
    };
    let nothing = json!({});
    for (file, of_frames, named) in [
        (
            with(&sphere, "rolling_shutter_time", json!(0.01)),
            nothing.clone(),
            "rolling_shutter_time",
        ),
        (
            sphere.clone(),
            with(&nothing, "fisheye_crop_radius", json!(9)),
            "fisheye_crop_radius",
        ),
        (sphere.clone(), with(&nothing, "s1", json!(0.1)), "s1"),
        (
            sphere.clone(),
            with(&nothing, "camera_model", json!("PINHOLE")),
            "camera_model",
        ),
        (sphere.clone(), with(&nothing, "w", json!(64)), "w of"),
        (
            with(&sphere, "k1", json!(0.1)),
            nothing.clone(),
            "EQUIRECTANGULAR",
        ),
        (with(&sphere, "fl_y", json!(8.0)), nothing.clone(), "fl_y"),
        (
            with(&sphere, "camera_angle_x", json!(0.9)),
            nothing.clone(),
            "camera_angle_x",
        ),
        (json!({"w": 32, "h": 16}), nothing.clone(), "fl_x"),
    ] {
        let text = ns_process_data(&file, &of_frames).to_string();
        foreign.write("transforms.json", text);
        let line = foreign.refusal("nerfstudio");
        assert!(
            line.contains(named) && line.contains("transforms.json"),
            "{line}"
        );
    }
    let timed = with(&nothing, "time", json!(0.25));
    foreign.write(
        "transforms.json",
        ns_process_data(&sphere, &timed).to_string(),
    );
    assert!(notes(&foreign.import("nerfstudio").unwrap(), "(time)"));
}

/// OpenMVG's data as cereal writes them: types are named once.
fn sfm_data(intrinsics: &[(&str, Value)], of_view: impl Fn(u32) -> u32, version: &str) -> Value {
    let mut named: Vec<&str> = Vec::new();
    let intrinsics: Vec<Value> = (0_u32..)
        .zip(intrinsics)
        .map(|(key, (name, data))| {
            let at = named.iter().position(|known| known == name);
            let id = at.unwrap_or(named.len()) as u32 + 1;
            let mut value = json!({"ptr_wrapper": {"id": (1_u32 << 31) + 40 + key, "data": data}});
            if at.is_none() {
                named.push(*name);
                value["polymorphic_id"] = json!((1_u32 << 31) + id);
                value["polymorphic_name"] = json!(name);
            } else {
                value["polymorphic_id"] = json!(id);
            }
            json!({"key": key, "value": value})
        })
        .collect();
    let views: Vec<Value> = (0_u32..)
        .zip(IMAGES)
        .map(|(key, (name, _))| {
            let filename = name.trim_start_matches("images/");
            let mut value = json!({"ptr_wrapper": {"id": (1_u32 << 31) + 1 + key, "data": {
                "local_path": "", "filename": filename, "width": 32, "height": 16,
                "id_view": key, "id_intrinsic": of_view(key), "id_pose": key + 70,
            }}});
            if version == "0.3" {
                value["polymorphic_id"] = json!(1_u32 << 30);
            }
            json!({"key": key, "value": value})
        })
        .collect();
    let extrinsics: Vec<Value> = (70_u32..)
        .zip(IMAGES)
        .map(|(key, (_, number))| {
            let turn = glam::DMat3::from_quat(pose(number).rotation().unwrap().inverse());
            let rows: Vec<[f64; 3]> = (0..3).map(|n| turn.row(n).to_array()).collect();
            json!({"key": key, "value": {"rotation": rows, "center": pose(number).centre}})
        })
        .collect();
    json!({
        "sfm_data_version": version, "root_path": "images", "views": views, "intrinsics": intrinsics,
        "extrinsics": extrinsics, "structure": [], "control_points": [],
    })
}

#[test]
fn data_of_openmvg_is_read_as_cereal_writes_it() {
    let foreign = Foreign::new(SIZE, &IMAGES);
    let sphere = |width: u32, height: u32| {
        (
            "spherical",
            json!({"value0": {"width": width, "height": height}}),
        )
    };
    let pinhole = (
        "pinhole",
        json!({"width": 32, "height": 16, "focal_length": 20.5, "principal_point": [15.5, 8.25]}),
    );
    let three = [sphere(32, 16), sphere(32, 16), sphere(32, 16)];
    let unused = [
        pinhole.clone(),
        sphere(32, 16),
        sphere(64, 30),
        sphere(32, 16),
    ];
    let write = |data: Value| foreign.write("sfm_data.json", data.to_string());
    for data in [
        sfm_data(&three, |view| view, "0.3"),
        sfm_data(&three[..1], |_| 0, "0.1"),
        sfm_data(&unused, |view| 1 + 2 * (view % 2), "0.3"),
    ] {
        write(data);
        let scene = foreign.import("openmvg").unwrap();
        assert_eq!(scene.camera, CAMERA.into());
        assert_poses(&scene, &[1, 2, 3]);
    }
    write(sfm_data(
        &[pinhole.clone(), pinhole.clone()],
        |view| view % 2,
        "0.3",
    ));
    let camera = PinholeCamera::new([32, 16], [20.5, 20.5], [15.5, 8.25]);
    assert_eq!(foreign.import("openmvg").unwrap().camera, camera.into());
    let with = |name: &'static str, entry: &str, terms: &[f64]| {
        let mut intrinsic = (name, pinhole.1.clone());
        intrinsic.1[entry] = json!(terms);
        intrinsic
    };
    for (name, entry, terms) in [
        ("pinhole_radial_k1", "disto_k1", vec![-0.1]),
        ("pinhole_radial_k3", "disto_k3", vec![-0.1, 0.02, 0.001]),
        (
            "pinhole_brown_t2",
            "disto_t2",
            vec![-0.1, 0.02, 0.001, 0.002, -0.001],
        ),
        ("fisheye", "fisheye", vec![-0.02, 0.001, 0.0, 0.0]),
    ] {
        write(sfm_data(&[with(name, entry, &terms)], |_| 0, "0.3"));
        let scene = foreign.import("openmvg").unwrap();
        assert!(
            notes(&scene, "the lens") || notes(&scene, "wide lens"),
            "{name}"
        );
        assert_ne!(scene.camera, camera.into());
    }
    for (intrinsics, named) in [
        (vec![sphere(32, 15)], "32x15"),
        (
            vec![with("pinhole_radial_k7", "disto_k7", &[0.1])],
            "pinhole_radial_k7",
        ),
        (
            vec![with("pinhole_radial_k1", "disto_k1", &[0.1, 0.2])],
            "disto_k1",
        ),
        (vec![with("pinhole", "disto_k1", &[0.1])], "disto_k1"),
        (vec![sphere(32, 16), pinhole], "frame_00002.png"),
    ] {
        write(sfm_data(
            &intrinsics,
            |view| view % intrinsics.len() as u32,
            "0.3",
        ));
        let line = foreign.refusal("openmvg");
        assert!(
            line.contains(named) && line.contains("sfm_data.json"),
            "{line}"
        );
    }
}

#[test]
fn panoramas_of_forks_of_colmap_are_read() {
    let foreign = Foreign::new(SIZE, &IMAGES[..1]);
    let rows = [(7, 2, "frame_00001.png", 1)];
    for camera in [
        "2 EQUIRECTANGULAR 32 16 32 16\n",
        "2 SPHERICAL 32 16 32 16\n1 FOV 9 9 9 9 5 5 0.5\n",
        "2 SPHERE 32 16 1 16 8\n",
    ] {
        write_colmap_text(&foreign, "sparse/0", camera, &rows);
        foreign.write("sparse/0/cameras.txt", format!("{BYTE_ORDER_MARK}{camera}"));
        let scene = foreign.import("colmap").unwrap();
        assert_eq!(scene.camera, CAMERA.into());
        assert_poses(&scene, &[1]);
    }
    for camera in ["2 SPHERE 32 16 1 15 8\n", "2 EQUIRECTANGULAR 32 16 64 32\n"] {
        write_colmap_text(&foreign, "sparse/0", camera, &rows);
        assert!(foreign.refusal("colmap").contains("whole sphere"));
    }
    write_colmap_binary(
        &foreign,
        "sparse/0",
        &[(2, 17, [32, 16], &[32.0, 16.0])],
        &rows,
    );
    assert_poses(&foreign.import("colmap").unwrap(), &[1]);
    write_colmap_binary(
        &foreign,
        "sparse/0",
        &[(2, 17, [32, 16], &[32.0, 17.0])],
        &rows,
    );
    assert!(foreign.refusal("colmap").contains("whole sphere"));
}

#[test]
fn the_rest_of_a_line_is_the_name_of_its_image() {
    let names = ["at  night (1).png", "at night (1).png", "Über uns  2.png"];
    let images: Vec<String> = names.iter().map(|name| format!("images/{name}")).collect();
    let images: Vec<(&str, u8)> = images.iter().map(String::as_str).zip(1..).collect();
    let foreign = Foreign::new(SIZE, &images);
    let rows: Vec<_> = (1_u32..)
        .zip(names)
        .map(|(id, name)| (id, 1, name, id as u8))
        .collect();
    write_colmap_text(
        &foreign,
        "sparse/0",
        "1 EQUIRECTANGULAR 32 16 32 16\n",
        &rows,
    );
    let scene = foreign.import("colmap").unwrap();
    let mut shown: Vec<u8> = foreign.shown(&scene).iter().map(|(n, _)| *n).collect();
    assert_poses(&scene, &shown);
    shown.sort_unstable();
    assert_eq!(shown, [1, 2, 3]);
}

#[test]
fn of_several_models_the_largest_or_the_one_that_is_named_is_taken() {
    let foreign = Foreign::new(SIZE, &IMAGES);
    let camera = "1 EQUIRECTANGULAR 32 16 32 16\n";
    let row = |n: u8| {
        (
            u32::from(n),
            1,
            IMAGES[usize::from(n) - 1].0.trim_start_matches("images/"),
            n,
        )
    };
    write_colmap_text(&foreign, "sparse/0", camera, &[row(3)]);
    write_colmap_text(&foreign, "sparse/2", camera, &[row(1), row(2)]);
    let sphere: &[f64] = &[32.0, 16.0];
    write_colmap_binary(
        &foreign,
        "sparse/10",
        &[(1, 17, [32, 16], sphere)],
        &[row(2)],
    );
    let scene = foreign.import("colmap").unwrap();
    assert_poses(&scene, &[1, 2]);
    assert!(notes(
        &scene,
        "sparse/2 (2 images) is taken, and not sparse/0 (1 images), sparse/10 (1 images)"
    ));
    assert!(notes(&scene, "images/frame_00003.png"));
    for (place, number) in [("sparse/0", 3), ("sparse/10", 2)] {
        let scene = foreign.import_from(place, "colmap").unwrap();
        assert_poses(&scene, &[number]);
        assert_eq!(foreign.shown(&scene)[0].0, number);
        assert!(!notes(&scene, "is taken"));
    }
}

#[test]
fn poses_without_images_and_images_without_poses_are_told() {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.paint("images/left/other.png", |_, _| [0; 3]);
    let camera = "1 EQUIRECTANGULAR 32 16 32 16\n";
    let rows = [(1, 1, "frame_00002.png", 2), (2, 1, "gone.png", 1)];
    write_colmap_text(&foreign, "sparse/0", camera, &rows);
    let scene = foreign.import("colmap").unwrap();
    assert_poses(&scene, &[2]);
    assert!(notes(&scene, ": 1 (gone.png)"));
    assert!(notes(
        &scene,
        ": 3 (images/frame_00001.png, images/frame_00003.png, images/left/other.png)"
    ));
    write_colmap_text(&foreign, "sparse/0", camera, &rows[1..]);
    assert!(foreign.refusal("colmap").contains("gone.png"));

    let sphere = json!({"camera_model": "EQUIRECTANGULAR", "w": 32, "h": 16});
    foreign.write("sparse_pc.ply", SPARSE_POINTS);
    foreign.write(
        "transforms.json",
        ns_process_data(&sphere, &json!({})).to_string(),
    );
    fs::remove_file(foreign.path().join("in/images/frame_00003.png")).unwrap();
    foreign.paint("images/spare.tif.png", |_, _| [0; 3]);
    let scene = foreign.import("nerfstudio").unwrap();
    assert_poses(&scene, &[1, 2]);
    assert!(notes(&scene, ": 1 (./images/frame_00003.png)") && notes(&scene, "spare.tif.png"));
}
