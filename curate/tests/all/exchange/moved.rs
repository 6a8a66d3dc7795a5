//! A scene in the coordinates of UTM, through every format and back.

use super::*;

/// From the scene's world to the one that it is moved to.
fn moved(place: DVec3) -> DVec3 {
    turn() * place + dvec3(5e5, 5e6, 0.0)
}

fn turn() -> DQuat {
    DQuat::from_rotation_z(0.7)
}

/// Rotation and place of a camera as another sees it.
fn relative(one: &Pose, other: &Pose) -> (DQuat, DVec3) {
    let to_one = one.rotation().unwrap().inverse();
    (
        to_one * other.rotation().unwrap(),
        to_one * (other.centre() - one.centre()),
    )
}

#[test]
fn a_scene_far_from_the_origin_comes_back_from_every_format_as_near_it() {
    let (folder, original) = scene();
    let cloud = PointCloud::read_ply(&folder.path().join("points.ply")).unwrap();
    let mut far = original.clone();
    for pose in far
        .frames
        .iter_mut()
        .filter_map(|frame| frame.pose.as_mut())
    {
        *pose = Pose::new(turn() * pose.rotation().unwrap(), moved(pose.centre()));
    }
    store::write_record(&folder.path().join("scene.json"), &far).unwrap();
    let far_cloud = PointCloud {
        positions: (cloud.positions.iter())
            .map(|&place| moved(DVec3::from_array(place)).to_array())
            .collect(),
        colours: cloud.colours.clone(),
    };
    far_cloud
        .write_ply(&folder.path().join("points.ply"))
        .unwrap();
    let near: Vec<Pose> = original
        .frames
        .iter()
        .filter_map(|frame| frame.pose)
        .collect();
    let distances = near
        .iter()
        .map(|pose| pose.centre().distance(near[0].centre()));
    let size = distances.fold(0.0, f64::max);
    for format in written_formats() {
        let (export, imported) = round_trip(format.id, folder.path(), &original.id);
        let back = export.path().join("back");
        let poses: Vec<Pose> = imported
            .frames
            .iter()
            .filter_map(|frame| frame.pose)
            .collect();
        assert_eq!(poses.len(), near.len());
        for (pose, truth) in poses.iter().zip(&near) {
            let (turned, place) = relative(&poses[0], pose);
            let (true_turn, true_place) = relative(&near[0], truth);
            assert!(turned.angle_between(true_turn) < 1e-6, "{}", format.id);
            let error = place.distance(true_place);
            assert!(error < 1e-6 * size, "{}: {error}", format.id);
            let error = pose.centre().distance(moved(truth.centre()));
            assert!(error < 1e-6 * size, "{}: {error}", format.id);
        }
        let Some(points) = imported.points else {
            continue;
        };
        let points = PointCloud::read_ply(&back.join(points)).unwrap();
        for (&found, &truth) in points.positions.iter().zip(&cloud.positions) {
            let error = DVec3::from_array(found).distance(moved(DVec3::from_array(truth)));
            assert!(error < 1e-6 * size, "{}: {error}", format.id);
        }
    }
}
