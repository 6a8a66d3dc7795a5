//! Data sets in the layout that ODGS shares: OpenMVG's views and extrinsics with lists of the split.

use serde_json::json;

use super::{
    foreign::{Foreign, assert_poses, notes, pose},
    *,
};

const SIZE: [u32; 2] = [32, 16];
const IMAGES: [(&str, u8); 5] = [
    ("images/0_0000.png", 1),
    ("images/0_0001.png", 2),
    ("images/0_0002.png", 3),
    ("images/0_0003.png", 4),
    ("images/0_0004.png", 5),
];

fn points(count: usize) -> String {
    let rows = "0.5 -1 2.25 0 255 0\n".repeat(count);
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty double x\nproperty double y\n\
         property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         end_header\n{rows}"
    )
}

/// Views without intrinsics, and extrinsics apart.
fn scene_of(train: &str, test: &str) -> Foreign {
    let foreign = Foreign::new(SIZE, &IMAGES);
    let (mut views, mut extrinsics) = (Vec::new(), Vec::new());
    for (key, (name, number)) in (0_u32..).zip(IMAGES) {
        views.push(json!({"key": key, "value": {
            "polymorphic_id": 1_073_741_824,
            "ptr_wrapper": {"id": 2_147_483_649_u32 + key, "data": {
                "local_path": "", "filename": name.trim_start_matches("images/"),
                "width": 32, "height": 16, "id_view": key, "id_intrinsic": 0, "id_pose": key,
            }},
        }}));
        let turn = glam::DMat3::from_quat(pose(number).rotation().unwrap().inverse());
        let rows: Vec<[f64; 3]> = (0..3).map(|row| turn.row(row).to_array()).collect();
        let value = json!({"rotation": rows, "center": pose(number).centre});
        extrinsics.push(json!({"key": key, "value": value}));
    }
    let data = |views: &[Value], extrinsics: &[Value]| {
        json!({
            "sfm_data_version": "0.3", "root_path": "/home/someone/images/", "views": views,
            "intrinsics": [], "extrinsics": extrinsics, "structure": [], "control_points": [],
        })
        .to_string()
    };
    foreign.write("data_views.json", data(&views, &[]));
    foreign.write("data_extrinsics.json", data(&[], &extrinsics));
    foreign.write("train.txt", train);
    foreign.write("test.txt", test);
    foreign
}

#[test]
fn the_lists_are_the_published_split() {
    let foreign = scene_of("0_0000\r\n0_0003\r\n\r\n0_0001", "0_0002\n");
    foreign.write("pcd.ply", points(2));
    foreign.write("colorized.ply", points(3));
    let scene = foreign.import("openmvg").unwrap();
    assert_eq!(scene.camera, CAMERA.into());
    assert_poses(&scene, &[1, 2, 3, 4, 5]);
    let split = scene.published_split.clone().unwrap();
    assert_eq!(split.input_views, [0, 1, 3]);
    assert_eq!(split.novel_views, [2]);
    // In neither list.
    assert!(notes(&scene, ": 1 (0_0004.png)"));
    let count = |scene: &Scene| {
        let file = foreign
            .path()
            .join("out")
            .join(scene.points.as_ref().unwrap());
        PointCloud::read_ply(&file).unwrap().len()
    };
    assert_eq!(count(&scene), 2);
    assert!(!notes(&scene, "colorized.ply"));
    fs::remove_file(foreign.path().join("in/pcd.ply")).unwrap();
    let scene = foreign.import("openmvg").unwrap();
    assert_eq!(count(&scene), 3);
    assert!(notes(&scene, "colorized.ply"));
}

#[test]
fn names_that_no_view_has_are_left_out_and_told() {
    let foreign = scene_of("0_0000\n9_0009\n0_0001.png\n", "0_0002\n9_0010\n");
    let scene = foreign.import("openmvg").unwrap();
    let split = scene.published_split.clone().unwrap();
    assert_eq!(split.input_views, [0, 1]);
    assert_eq!(split.novel_views, [2]);
    assert!(notes(&scene, ": 2 (9_0009, 9_0010)"));
}

#[test]
fn folders_without_images_for_testing_have_no_split() {
    // Like our own exports without a split, and OpenMVG's folders.
    let foreign = scene_of("0_0000\n0_0001\n", "");
    assert_eq!(foreign.import("openmvg").unwrap().published_split, None);
    for list in ["train.txt", "test.txt"] {
        fs::remove_file(foreign.path().join("in").join(list)).unwrap();
    }
    assert_eq!(foreign.import("openmvg").unwrap().published_split, None);
}

#[test]
fn lists_that_are_no_split_are_refused() {
    let foreign = scene_of("0_0000\n0_0001\n", "0_0002\n0_0001\n");
    assert!(foreign.refusal("openmvg").contains("0_0001"));
    fs::remove_file(foreign.path().join("in/train.txt")).unwrap();
    assert!(foreign.refusal("openmvg").contains("train.txt"));
}
