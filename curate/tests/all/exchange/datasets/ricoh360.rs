//! Scenes in the shape of `dataLoader/dataset_egocentric_video.py` of `EgoNeRF`.

use super::*;
use crate::exchange::foreign::notes;

const FRAMES: [(&str, u8); 3] = [("imgs/10.png", 3), ("imgs/9.png", 2), ("imgs/7.png", 1)];

/// World to camera, as COLMAP has it.
fn world_to_camera(number: u8) -> (DMat3, DVec3) {
    let (turn, place) = placed(number);
    (turn.transpose(), -(turn.transpose() * place))
}

fn ricoh360() -> Foreign {
    let foreign = Foreign::new(SIZE, &FRAMES);
    let rows: String = FRAMES
        .iter()
        .map(|(name, number)| {
            let (turn, shift) = world_to_camera(*number);
            let q = DQuat::from_mat3(&turn);
            let name = name.strip_prefix("imgs/").unwrap();
            let name = name.strip_suffix(".png").unwrap();
            format!(
                "{number} {} {} {} {} {} {} {} 0 {name}.jpg\n1.5 2.5 4\n",
                q.w, q.x, q.y, q.z, shift.x, shift.y, shift.z
            )
        })
        .collect();
    let head = "# Image list\n# two lines\n#   IMAGE_ID, QW\n# Number of images: 3\n";
    let model = "output_dir/colmap";
    foreign.write(&format!("{model}/images.txt"), format!("{head}{rows}"));
    // Of a camera that is known nowhere.
    foreign.write(&format!("{model}/cameras.txt"), "0 PANORAMA 32 16 1 2 3\n");
    foreign.write(
        &format!("{model}/points3D.txt"),
        "4 0.5 -1.25 3 250 3 7 0.4 1 0\n",
    );
    foreign.write("train.txt", "9\n10\n");
    foreign.write("test.txt", "7\n");
    foreign
}

/// `ColmapPoseDescriptor` and `get_ray_directions_360`, solved for the pixel: cameras are turned by `rays2cam`
/// on their right and by `world_align`, which turns the world points as well, on their left.
fn pixel(number: u8, world: DVec3) -> [f64; 2] {
    let (turn, shift) = world_to_camera(number);
    let align = DMat3::from_cols(DVec3::X, dvec3(0.0, 0.0, -1.0), DVec3::Y);
    let rays_to_camera = DMat3::from_diagonal(dvec3(1.0, -1.0, -1.0));
    let camera_to_world = align * turn.transpose() * rays_to_camera;
    let place = align * -(turn.transpose() * shift);
    let ray = camera_to_world.transpose() * (align * world - place);
    let theta = (ray.y / ray.length()).asin();
    let phi = (-ray.x).atan2(-ray.z);
    [
        (1.0 - phi / PI) * 32.0 / 2.0,
        (1.0 - 2.0 * theta / PI) * 16.0 / 2.0,
    ]
}

#[test]
fn cameras_see_what_the_loader_sees() {
    let foreign = ricoh360();
    foreign.paint("imgs/mask.png", |_, _| [255; 3]);
    let scene = import_as_is(&foreign, "ricoh360").unwrap();
    for (frame, number) in [1, 2, 3].into_iter().enumerate() {
        assert_sees(&scene, frame, placed(number).1, |world| {
            pixel(number, world)
        });
    }
    assert_eq!(times(&scene), [0.0, 2.0, 3.0]);
    assert_eq!(split_of(&scene), (vec![1, 2], vec![0]));
    assert!(notes(&scene, "imgs/mask.png"));
    let points = PointCloud::read_ply(&foreign.path().join("out/points.ply")).unwrap();
    assert_eq!(points.positions, [[0.5, -1.25, 3.0]]);
    assert_eq!(points.colours, [[250, 3, 7]]);
}

#[test]
fn poses_and_images_that_are_not_there_are_refused_or_told() {
    let foreign = ricoh360();
    fs::remove_file(foreign.path().join("in/imgs/9.png")).unwrap();
    let scene = foreign.import("ricoh360").unwrap();
    assert_eq!(scene.frames.len(), 2);
    assert!(scene.published_split.is_none() && notes(&scene, "imgs/9.png"));
    foreign.write(
        "output_dir/colmap/images.txt",
        "1 nan 0 0 0 0 0 0 0 7.png\n\n",
    );
    assert!(foreign.refusal("ricoh360").contains("images.txt"));
    fs::remove_file(foreign.path().join("in/output_dir/colmap/images.txt")).unwrap();
    assert!(foreign.refusal("ricoh360").contains("images.txt"));
}
