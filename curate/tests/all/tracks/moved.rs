//! A flight in the coordinates of UTM: its tracks are those of the same flight near the origin.

use super::*;

/// From the flight's world to the one that it is moved to, a quarter turn about the vertical away.
fn moved(place: DVec3) -> DVec3 {
    turn() * place + dvec3(5e5, 5e6, 0.0)
}

fn turn() -> DQuat {
    DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2)
}

#[test]
fn tracks_far_from_the_origin_are_those_near_it() {
    let temp = tempfile::tempdir().unwrap();
    let folders = ["near", "far"].map(|name| temp.path().join(name));
    let scene = write_scene(&folders[0].join("scene"));
    let mut far = write_scene(&folders[1].join("scene"));
    for pose in far
        .frames
        .iter_mut()
        .filter_map(|frame| frame.pose.as_mut())
    {
        *pose = Pose::new(turn() * pose.rotation().unwrap(), moved(pose.centre()));
    }
    let of_far = folders[1].join("scene");
    store::write_record(&of_far.join("scene.json"), &far).unwrap();
    let file = of_far.join("points.ply");
    let mut points = PointCloud::read_ply(&file).unwrap();
    for position in &mut points.positions {
        *position = moved(DVec3::from_array(*position)).to_array();
    }
    points.write_ply(&file).unwrap();
    // The same pixels in both.
    let boxes = boxes(&scene);
    let [near, far] =
        folders.map(|folder| make_tracks(&request(&folder, &boxes), &Silent).unwrap());
    assert_eq!(near.tracks.len(), 2);
    assert_eq!(far.tracks.len(), near.tracks.len());
    for track in &near.tracks {
        let [begin, end] = track.path.centre.range();
        let middle = |track: &omnilife_schemas::records::Track| track.path.at(0.5 * (begin + end));
        let (place, _) = middle(track).unwrap();
        let distance = |other: &&omnilife_schemas::records::Track| {
            middle(other).map_or(f64::INFINITY, |(at, _)| at.distance(moved(place)))
        };
        let other = (far.tracks.iter())
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap();
        for share in [0.1, 0.5, 0.9] {
            let seconds = begin + share * (end - begin);
            let ((place, heading), (found, turned)) = (
                track.path.at(seconds).unwrap(),
                other.path.at(seconds).unwrap(),
            );
            let error = found.distance(moved(place));
            assert!(error < 0.02, "{error} m at {seconds} s");
            let change = turned - heading - std::f64::consts::FRAC_PI_2;
            assert!(change.cos() > 1.0 - 1e-4, "{change} radians");
        }
        for (side, expected) in other.dimensions.iter().zip(track.dimensions) {
            assert!((side - expected).abs() < 0.02, "{side} m, not {expected}");
        }
    }
}
