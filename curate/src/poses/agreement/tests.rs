//! Conventions of poses, told apart by exact motion.

use super::*;

/// Returns a walk that bends, and what images of it show.
fn walk() -> (Vec<Option<Pose>>, Vec<PairInImages>) {
    let pose = |frame: usize| {
        let seconds = 0.3 * frame as f64;
        let turn = DQuat::from_rotation_y(0.25 * seconds.sin())
            * DQuat::from_rotation_x(0.2 * (1.7 * seconds).cos());
        let centre = DVec3::new(seconds, 0.1 * (2.0 * seconds).sin(), 0.6 * seconds.cos());
        Some(Pose::new(turn, centre))
    };
    let poses: Vec<Option<Pose>> = (0..13).map(pose).collect();
    let pairs = (0..12).map(|frame| {
        let both = [frame, frame + 1].map(|frame| poses[frame].as_ref());
        let [Some(first), Some(second)] = both else {
            panic!("a pose")
        };
        let motion = Convention::AS_READ.motion([first, second]);
        let (turn, moved) = motion.expect("unit quaternions");
        PairInImages {
            frames: [frame, frame + 1],
            turn,
            heading: Some(moved.normalize()),
        }
    });
    let pairs = pairs.collect();
    (poses, pairs)
}

/// Returns poses as a program of another convention writes them: those that this convention reads back.
fn written(convention: Convention, poses: &[Option<Pose>]) -> Vec<Option<Pose>> {
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let write = |pose: &Pose| {
        let to_world = DMat3::from_quat(pose.rotation().expect("a rotation"));
        // A mirrored world has mirrored cameras, so that their product is a rotation again.
        let (to_world, centre) = if convention.is_mirrored {
            (mirror * to_world * mirror, mirror * pose.centre())
        } else {
            (to_world, pose.centre())
        };
        let turned = DQuat::from_mat3(&(to_world * convention.axes)).normalize();
        if convention.is_inverse {
            let inverse = turned.inverse();
            Pose::new(inverse, -(inverse * centre))
        } else {
            Pose::new(turned, centre)
        }
    };
    poses.iter().map(|pose| pose.as_ref().map(write)).collect()
}

/// Checks the motion of two poses by places that both cameras see.
#[test]
fn motion_is_that_of_what_cameras_see() {
    let (poses, _) = walk();
    let [Some(first), Some(second)] = [poses[3], poses[9]] else {
        panic!("poses")
    };
    let seen = |pose: &Pose, place: DVec3| {
        let to_world = DMat3::from_quat(pose.rotation().expect("a rotation"));
        to_world.transpose() * (place - pose.centre())
    };
    let motion = Convention::AS_READ.motion([&first, &second]);
    let (turn, moved) = motion.expect("unit quaternions");
    for place in [DVec3::new(3.0, 1.0, -2.0), DVec3::new(-0.4, 2.0, 5.0)] {
        let expected = turn * (seen(&first, place) - moved);
        assert!((expected - seen(&second, place)).length() < 1e-12);
    }
    assert!((moved - seen(&first, second.centre())).length() < 1e-12);
}

#[test]
fn there_are_24_rotations_of_axes() {
    let all = rotations_of_axes();
    assert_eq!(all.len(), 24);
    assert_eq!(all[0], DMat3::IDENTITY);
    for (index, one) in all.iter().enumerate() {
        assert_eq!(one.determinant(), 1.0);
        assert!(!all[..index].contains(one));
    }
}

#[test]
fn poses_of_every_convention_are_told_by_it() {
    let (poses, pairs) = walk();
    let line = |poses: &[Option<Pose>]| {
        disagreement(&Convention::AS_READ.compare(&pairs, poses), &pairs, poses)
    };
    assert_eq!(line(&poses), None);
    for convention in Convention::all() {
        let given = written(convention, &poses);
        let found = convention.compare(&pairs, &given);
        assert!(found.holds() && found.agree == 12, "{found:?}");
        assert!(found.turn_error < Some(1e-6), "{found:?}");
        if convention != Convention::AS_READ {
            let (named, line) = line(&given).expect("wrong poses");
            assert_eq!(named, Some(convention), "{line}");
        }
    }
}

#[test]
fn poses_of_another_path_are_in_doubt_without_a_name() {
    let (poses, pairs) = walk();
    let other = |frame: usize| {
        let angle = 2.4 * frame as f64;
        let axis = DVec3::new(angle.sin(), angle.cos(), (0.3 * angle).sin()).normalize();
        Some(Pose::new(DQuat::from_axis_angle(axis, 0.5), axis))
    };
    let others: Vec<Option<Pose>> = (0..poses.len()).map(other).collect();
    let as_read = Convention::AS_READ.compare(&pairs, &others);
    let found = disagreement(&as_read, &pairs, &others).expect("wrong poses");
    assert_eq!(found.0, None, "{}", found.1);
}

/// Checks that a camera that stands still, and turns by nothing, tells nothing.
#[test]
fn a_camera_at_rest_tells_nothing() {
    let (poses, pairs) = walk();
    let still: Vec<PairInImages> = pairs
        .iter()
        .map(|pair| PairInImages {
            turn: DQuat::IDENTITY,
            heading: None,
            ..*pair
        })
        .collect();
    let resting = vec![poses[0]; poses.len()];
    let found = Convention::AS_READ.compare(&still, &resting);
    assert_eq!((found.told, found.turn_error), (0, None));
}
