//! Tracks of a hovering camera over the planar ground that its poses come with.

use super::*;

/// Share of a vehicle's length that its place may be off by.
const SHARE: f64 = 0.05;

#[test]
fn vehicles_on_planar_ground_have_their_places_in_metres() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let mut scene = write_scene(&folder);
    for frame in &mut scene.frames {
        let seconds = frame.time_seconds;
        let turn = DMat3::from_rotation_z(0.01 * seconds);
        let looks_down = turn * DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let tilt = DMat3::from_rotation_x(0.02 * seconds.sin());
        frame.pose = Some(Pose::new(
            DQuat::from_mat3(&(looks_down * tilt)),
            dvec3(0.0, -2.0, 40.0),
        ));
    }
    scene.pose_source = PoseSource::Registered {
        reason: "turns".to_owned(),
        succeeded: true,
    };
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
    let tracks = make_tracks(&request(temp.path(), &boxes(&scene)), &Silent).unwrap();
    let is_told = |line: &String| line.contains("assumed to be a plane");
    assert!(tracks.warnings.iter().any(is_told), "{:?}", tracks.warnings);
    assert_eq!((tracks.tracks.len(), tracks.metres_per_unit), (2, 1.0));
    for track in &tracks.tracks {
        let [begin, end] = track.path.centre.range();
        for step in 0..=20 {
            let seconds = (begin + (end - begin) * f64::from(step) / 20.0).min(end);
            let place = track.path.at(seconds).unwrap().0;
            let errors = (0..2).map(|number| (place - car(number, seconds).0).truncate().length());
            let error = errors.fold(f64::INFINITY, f64::min);
            assert!(error < SHARE * 4.5, "{error} m at {seconds} s");
        }
    }
}
