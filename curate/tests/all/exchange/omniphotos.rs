//! Scenes of OmniPhotos in the form in which its preprocessing writes and its loader reads them.

use super::{
    foreign::{Foreign, assert_poses, notes, pose},
    *,
};

const SIZE: [u32; 2] = [32, 16];
const IMAGES: [(&str, u8); 3] = [
    ("Input/panoramic-0695.png", 1),
    ("Input/panoramic-0696.png", 2),
    ("Input/panoramic-0698.png", 3),
];
const MODEL_FILES: &str = "../Capture/openvslam/cameras.txt\n\
                           ../Capture/openvslam/frame_trajectory_with_filename.txt\n\
                           ../Capture/openvslam/map.msg";
const TRAJECTORY: &str = "Capture/openvslam/frame_trajectory_with_filename.txt";
/// Camera of the video, which is larger than the images.
const CAMERAS: &str = "# Camera list with one line of data per camera:\r\n\
                       #   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\r\n\
                       # Number of cameras: 1\r\n\
                       1 EQUIRECTANGULAR 3840 1920 500 1920.0 960.0\r\n";

/// A line of the trajectory: index, name, and the pose of a number, camera to world.
fn line(index: i32, name: &str, number: u8) -> String {
    let pose = pose(number);
    let ([x, y, z], [qw, qx, qy, qz]) = (pose.centre, pose.rotation_wxyz);
    format!("{index} {name} {x} {y} {z} {qx} {qy} {qz} {qw}\r\n")
}

/// The trajectory of all images, with one that has no pose.
fn trajectory() -> String {
    [
        "#index filename trans_wc.x trans_wc.y trans_wc.z quat_wc.x quat_wc.y quat_wc.z quat_wc.w\r\n"
            .to_owned(),
        line(695, "panoramic-0695.png", 1),
        line(696, "Input/panoramic-0696.png", 2),
        line(-1, "panoramic-0697.png", 9),
        line(698, "panoramic-0698.png", 3),
    ]
    .concat()
}

/// A text of MessagePack, shorter than 32 bytes.
fn packed(text: &str) -> Vec<u8> {
    let mut bytes = vec![0xa0 | text.len() as u8];
    bytes.extend(text.bytes());
    bytes
}

/// A map as nlohmann's JSON writes it: entries in the order of their names, numbers as doubles.
fn map(landmarks: &[(&str, [f64; 3])]) -> Vec<u8> {
    let mut bytes = vec![0x83];
    bytes.extend(packed("cameras"));
    bytes.extend(
        [0x81]
            .into_iter()
            .chain(packed("cols"))
            .chain([0xcd, 0x0f, 0]),
    );
    bytes.extend(packed("keyframes"));
    // Descriptors: arrays in arrays.
    bytes.extend([0x81].into_iter().chain(packed("0")));
    bytes.extend([0x92, 0x92, 0xcc, 200, 7, 0x91, 0xff]);
    bytes.extend(packed("landmarks"));
    bytes.push(0x80 | landmarks.len() as u8);
    for (id, place) in landmarks {
        bytes.extend(packed(id));
        bytes.push(0x82);
        bytes.extend(packed("1st_keyfrm").into_iter().chain([4]));
        bytes.extend(packed("pos_w").into_iter().chain([0x93]));
        for value in place {
            bytes.push(0xcb);
            bytes.extend(value.to_be_bytes());
        }
    }
    bytes
}

fn scene_of(trajectory: impl AsRef<[u8]>) -> Foreign {
    let foreign = Foreign::new(SIZE, &IMAGES);
    foreign.write("Config/modelFiles.openvslam", MODEL_FILES);
    foreign.write("Capture/openvslam/cameras.txt", CAMERAS);
    foreign.write("Capture/openvslam/map.msg", map(&[]));
    foreign.write(TRAJECTORY, trajectory);
    foreign
}

#[test]
fn poses_of_the_trajectory_and_landmarks_of_the_map_are_read() {
    let foreign = scene_of(trajectory());
    let landmarks = [("12", [0.25, -1.5, 3.0]), ("7", [1.0e-3, 2.0, -8.125])];
    foreign.write("Capture/openvslam/map.msg", map(&landmarks));
    let scene = foreign.import("omniphotos").unwrap();
    // The size of the images.
    assert_eq!(scene.camera, CAMERA.into());
    assert_poses(&scene, &[1, 2, 3]);
    assert_eq!(foreign.shown(&scene), [(1, 0), (2, 10), (3, 30)]);
    let cloud = PointCloud::read_ply(&foreign.path().join("out/points.ply")).unwrap();
    assert_eq!(cloud.len(), 2);
    for (found, (_, expected)) in cloud.positions.iter().zip(landmarks) {
        let apart = DVec3::from_array(*found).distance(DVec3::from_array(expected));
        assert!(apart < 1e-6, "{found:?}");
    }
    assert!(notes(&scene, "grey"));
    assert_eq!(scene.published_split, None);
}

/// The shader of the viewer, `computeEquirectTextureCoord`, behind the loader's turn of the world.
#[test]
fn a_point_is_seen_where_the_viewer_sees_it() {
    let scene = scene_of(trajectory()).import("omniphotos").unwrap();
    let turned = |p: DVec3| dvec3(p.x, -p.y, -p.z);
    let truth = pose(2);
    for world in [
        dvec3(4.0, -1.0, 0.5),
        dvec3(-2.0, 3.0, 7.0),
        dvec3(0.3, -5.0, -6.0),
    ] {
        // C' = T C, and R' = R^T T takes what is turned back again.
        let (point, centre) = (turned(world), turned(truth.centre()));
        let p = truth.rotation().unwrap().inverse() * turned(point - centre);
        let direction = p.normalize();
        let (theta, phi) = (direction.z.atan2(direction.x), direction.y.asin());
        // Texture coordinates begin at the bottom of a picture that is stored from its top, and are inverted.
        let u = (0.75 - theta / TAU).rem_euclid(1.0);
        let v = 1.0 - (0.5 - phi / PI);
        let found = scene.frames[1].pose.unwrap();
        let camera = found.rotation().unwrap().inverse() * (world - found.centre());
        let seen = CAMERA.project(camera).unwrap();
        let across = CAMERA.wrapped_column_distance(32.0 * u, seen.x);
        assert!(
            across.abs() < 1e-6 && (seen.y - 16.0 * v).abs() < 1e-6,
            "{seen}, expected {u}, {v} of the size"
        );
    }
}

#[test]
fn scenes_may_lack_a_map_and_images() {
    let foreign = scene_of(trajectory());
    let scene = foreign.import("omniphotos").unwrap();
    assert_eq!(scene.points, None);
    assert!(notes(&scene, "no points"));
    let two = MODEL_FILES.rsplit_once('\n').unwrap().0;
    foreign.write("Config/modelFiles.openvslam", two);
    fs::remove_file(foreign.path().join("in/Capture/openvslam/map.msg")).unwrap();
    fs::remove_file(foreign.path().join("in").join(IMAGES[1].0)).unwrap();
    let scene = foreign.import("omniphotos").unwrap();
    assert_poses(&scene, &[1, 3]);
    assert!(notes(&scene, "no points") && notes(&scene, ": 1 (panoramic-0696.png)"));
    // A map that is named has to be there.
    foreign.write("Config/modelFiles.openvslam", MODEL_FILES);
    assert!(foreign.refusal("omniphotos").contains("map.msg"));
}

#[test]
fn malformed_trajectories_are_refused_with_their_line() {
    let first = line(695, "panoramic-0695.png", 1);
    let nine = "panoramic-0696.png 0 0 0";
    for (second, named) in [
        (format!("696 {nine} 0 0 0 NaN\r\n"), "finite"),
        (format!("696 {nine} 0 0 0 inf\r\n"), "finite"),
        (format!("696 {nine} 0 0 x 1\r\n"), "finite"),
        (format!("696 {nine} 0 0 0\r\n"), "has 6 numbers"),
        (format!("696 {nine} 0 0 0 1 0\r\n"), "has 8 numbers"),
        (format!("696 {nine} 0 0 0 0\r\n"), "length 0"),
        (format!("696 {nine} 0 0 0 2\r\n"), "length 2"),
        // OpenVSLAM's own file has times and no names.
        ("23.2 0 0 0 0 0 0 1\r\n".to_owned(), "23.2"),
        ("696\r\n".to_owned(), "file name"),
        (first.clone(), "panoramic-0695.png"),
    ] {
        let refusal = scene_of(format!("{first}{second}")).refusal("omniphotos");
        assert!(
            refusal.contains(named)
                && refusal.contains("line 2")
                && refusal.contains("frame_trajectory"),
            "{refusal}"
        );
    }
    let outside = scene_of(line(1, "a/../Config/modelFiles.openvslam", 1));
    assert!(
        outside
            .refusal("omniphotos")
            .contains("leads out of the folder")
    );
    assert!(
        scene_of("# nothing\r\n")
            .refusal("omniphotos")
            .contains("no poses")
    );
}

#[test]
fn other_cameras_and_broken_files_are_refused() {
    for (file, content, named) in [
        (
            "Capture/openvslam/cameras.txt",
            b"1 SIMPLE_PINHOLE 32 16 20 16 8\n".to_vec(),
            "SIMPLE_PINHOLE",
        ),
        (
            "Capture/openvslam/cameras.txt",
            b"# none\n".to_vec(),
            "0 cameras",
        ),
        ("Config/modelFiles.openvslam", b"\n\n".to_vec(), "cameras"),
        (
            "Config/modelFiles.openvslam",
            b"../Capture/openvslam/cameras.txt\n".to_vec(),
            "trajectory",
        ),
        (
            "Config/modelFiles.openvslam",
            b"../../outside.txt\nx\n".to_vec(),
            "leads out of the folder",
        ),
        (
            "Capture/openvslam/map.msg",
            b"\x93\x01\x02\x03".to_vec(),
            "byte 1",
        ),
        (TRAJECTORY, b"1 \xff\xfe 0\n".to_vec(), "UTF-8 at byte 2"),
    ] {
        let foreign = scene_of(trajectory());
        fs::write(foreign.path().join("outside.txt"), CAMERAS).unwrap();
        foreign.write(file, content);
        let refusal = foreign.refusal("omniphotos");
        assert!(refusal.contains(named), "{refusal}");
    }
}
