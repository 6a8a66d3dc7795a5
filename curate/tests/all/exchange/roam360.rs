//! Scenes of 360Roam in the shape in which their authors publish them.

use serde_json::json;

use super::{
    foreign::{Foreign, assert_poses, notes, pose},
    *,
};

const SIZE: [u32; 2] = [32, 16];
const IMAGES: [(&str, u8); 4] = [
    ("images/3_0007.png", 1),
    ("images/3_0008.png", 2),
    ("images/3_0011.png", 3),
    ("images/3_0015.png", 4),
];
const POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                      property float z\nproperty uchar red\nproperty uchar green\n\
                      property uchar blue\nend_header\n1.5 -2.25 0.125 9 8 7\n0 4 -1 250 3 1\n";

/// An entry of `pose_c2w.json` for the image and frame of this place.
fn entry(at: usize) -> Value {
    let (name, number) = IMAGES[at];
    let pose = pose(number);
    let turn = glam::DMat3::from_quat(pose.rotation().unwrap());
    let row = |n: usize| {
        [
            turn.x_axis[n],
            turn.y_axis[n],
            turn.z_axis[n],
            pose.centre[n],
        ]
    };
    json!({
        "rgb_file": name.trim_start_matches("images/"),
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    })
}

fn poses() -> Value {
    json!({"train": [entry(3), entry(0), entry(2)], "test": [entry(1)]})
}

/// The poses with a change.
fn with(change: impl Fn(&mut Value)) -> String {
    let mut changed = poses();
    change(&mut changed);
    changed.to_string()
}

fn scene_of(poses: impl AsRef<[u8]>) -> Foreign {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.write("pose_c2w.json", poses);
    foreign.write("scene.ply", POINTS);
    foreign
}

#[test]
fn poses_points_and_split_are_those_of_the_authors() {
    let foreign = scene_of(poses().to_string());
    let scene = foreign.import("360roam").unwrap();
    assert_eq!(scene.camera, CAMERA.into());
    assert_poses(&scene, &[1, 2, 3, 4]);
    let cloud = PointCloud::read_ply(&foreign.path().join("out/points.ply")).unwrap();
    assert_eq!(cloud.positions, [[1.5, -2.25, 0.125], [0.0, 4.0, -1.0]]);
    assert_eq!(cloud.colours, [[9, 8, 7], [250, 3, 1]]);
    let split = scene.published_split.unwrap();
    assert_eq!(split.input_views, [0, 2, 3]);
    assert_eq!(split.novel_views, [1]);
    assert!(split.source.contains("360Roam"));
}

#[test]
fn times_are_not_asked_for() {
    let foreign = scene_of(poses().to_string());
    let scene = import(&ImportRequest::new(
        &foreign.path().join("in"),
        "360roam",
        "foreign",
        &foreign.path().join("out"),
    ));
    let scene = scene.unwrap();
    assert_eq!(
        foreign.shown(&scene),
        [(1, 0), (2, 100), (3, 400), (4, 800)]
    );
}

/// OmniGS: `Rcw = inv(Rwc)`, `tcw = -Rcw twc`, and `point3ToLonlatPixel`.
#[test]
fn a_point_is_seen_where_the_loader_sees_it() {
    let foreign = scene_of(poses().to_string());
    let scene = foreign.import("360roam").unwrap();
    let rows = &entry(2)["transform_matrix"];
    let at = |row: usize, column: usize| rows[row][column].as_f64().unwrap();
    for world in [
        dvec3(4.0, -1.0, 0.5),
        dvec3(-2.0, 3.0, 7.0),
        dvec3(0.3, -5.0, -6.0),
    ] {
        let shifted = world - dvec3(at(0, 3), at(1, 3), at(2, 3));
        let axis = |c: usize| dvec3(at(0, c), at(1, c), at(2, c)).dot(shifted);
        let p = dvec3(axis(0), axis(1), axis(2));
        let (longitude, latitude) = (p.x.atan2(p.z), (p.y / p.length()).asin());
        let (u, v) = (
            (longitude / PI + 1.0) * 16.0,
            (latitude * 2.0 / PI + 1.0) * 8.0,
        );
        let found = scene.frames[2].pose.unwrap();
        let camera = found.rotation().unwrap().inverse() * (world - found.centre());
        let seen = CAMERA.project(camera).unwrap();
        assert!(
            (seen.x - u).abs() < 1e-6 && (seen.y - v).abs() < 1e-6,
            "{seen}, expected {u}, {v}"
        );
    }
}

#[test]
fn points_may_have_the_name_of_the_folder() {
    let foreign = Foreign::new(SIZE, &[]);
    for (name, number) in IMAGES {
        foreign.paint(&format!("library/{name}"), |_, _| [20 * number; 3]);
    }
    foreign.write("library/pose_c2w.json", poses().to_string());
    let scene = foreign.import_from("library", "360roam").unwrap();
    assert_eq!(scene.points, None);
    assert!(notes(&scene, "no points"));
    foreign.write("library/library.ply", POINTS);
    let scene = foreign.import_from("library", "360roam").unwrap();
    assert!(scene.points.is_some() && !notes(&scene, "no points"));
}

#[test]
fn images_that_are_not_there_are_told() {
    let foreign = scene_of(poses().to_string());
    let remove = |at: usize| fs::remove_file(foreign.path().join("in").join(IMAGES[at].0));
    remove(2).unwrap();
    let scene = foreign.import("360roam").unwrap();
    assert_poses(&scene, &[1, 2, 4]);
    assert!(notes(&scene, ": 1 (3_0011.png)"));
    // Another split than the published one is not passed off as it.
    assert_eq!(scene.published_split, None);
    for at in [0, 1, 3] {
        remove(at).unwrap();
    }
    assert!(foreign.refusal("360roam").contains("3_0015.png"));
}

#[test]
fn malformed_poses_are_refused_with_their_file() {
    let not_a_number = poses().to_string().replacen("1.0]]", "NaN]]", 1);
    assert!(not_a_number.contains("NaN"));
    for (text, named) in [
        ("{\"train\": [".to_owned(), "line 1"),
        (not_a_number, "line 1"),
        (with(|poses| poses["test"] = Value::Null), "line 1"),
        (
            with(|poses| drop(poses.as_object_mut().unwrap().remove("test"))),
            "test",
        ),
        (
            with(|poses| poses["train"][0]["transform_matrix"] = json!([[1.0, 0.0, 0.0, 0.0]])),
            "line 1",
        ),
        (
            with(|poses| poses["train"][1]["transform_matrix"][1][3] = Value::Null),
            "line 1",
        ),
        (
            with(|poses| poses["train"][2]["transform_matrix"][3][3] = json!(2.0)),
            "3_0011.png",
        ),
        (
            with(|poses| poses["test"][0]["transform_matrix"][0][0] = json!(3.5)),
            "3_0008.png",
        ),
        (with(|poses| poses["test"][0] = entry(3)), "3_0015.png"),
        (with(|poses| poses["test"] = json!([])), "testing"),
    ] {
        let line = scene_of(&text).refusal("360roam");
        assert!(
            line.contains(named) && line.contains("pose_c2w.json"),
            "{line}"
        );
    }
    let outside = with(|poses| poses["train"][0]["rgb_file"] = json!("../scene.ply"));
    assert!(
        scene_of(outside)
            .refusal("360roam")
            .contains("leads out of the folder")
    );
    // Without content, and larger than any list of poses.
    let huge = scene_of("");
    let file = fs::File::create(huge.path().join("in/pose_c2w.json")).unwrap();
    file.set_len((1 << 26) + 1).unwrap();
    assert!(huge.refusal("360roam").contains("more than"));
}
