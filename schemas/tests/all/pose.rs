//! Poses and the scene similarity.

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_schemas::{
    Pose, Similarity,
    pose::{far_cameras, far_frames, one_place},
};
use proptest::prelude::*;

fn rotations() -> impl Strategy<Value = DQuat> {
    let part = || prop_oneof![4 => -1.0..1.0_f64, 1 => Just(0.0), 1 => -1e-9..1e-9_f64];
    (part(), part(), part(), part())
        .prop_map(|(x, y, z, w)| DQuat::from_xyzw(x, y, z, w))
        .prop_filter("not zero", |q| q.length() > 1e-6)
        .prop_map(DQuat::normalize)
}

fn vectors(half_range: f64) -> impl Strategy<Value = DVec3> {
    let part = move || -half_range..half_range;
    (part(), part(), part()).prop_map(|(x, y, z)| dvec3(x, y, z))
}

proptest! {
    #[test]
    fn matrices_come_back(rotation in rotations(), centre in vectors(1e6)) {
        let matrix = DMat3::from_quat(rotation);
        let pose = Pose::from_matrix(matrix, centre);
        prop_assert!(pose.is_some());
        if let Some((pose, back)) = pose.and_then(|pose| Some((pose, pose.rotation()?))) {
            prop_assert!(DMat3::from_quat(back).abs_diff_eq(matrix, 1e-12));
            prop_assert_eq!(pose.centre(), centre);
            prop_assert!(pose.is_valid());
        }
    }

    #[test]
    fn quaternions_of_any_length_mean_the_same(rotation in rotations(), exponent in -9.0..9.0) {
        let length = 10.0_f64.powf(exponent);
        let [x, y, z, w] = (rotation * length).to_array();
        let pose = Pose { rotation_wxyz: [w, x, y, z], centre: [0.0; 3] };
        let back = pose.rotation();
        prop_assert!(back.is_some_and(|q| q.dot(rotation).abs() > 1.0 - 1e-14));
    }

    #[test]
    fn reflections_are_refused(rotation in rotations(), axis in 0_usize..3) {
        let mut matrix = DMat3::from_quat(rotation);
        *matrix.col_mut(axis) *= -1.0;
        prop_assert_eq!(Pose::from_matrix(matrix, DVec3::ZERO), None);
    }

    #[test]
    fn scales_and_shears_are_refused(rotation in rotations(), factor in 1.01..100.0) {
        let matrix = DMat3::from_quat(rotation);
        prop_assert_eq!(Pose::from_matrix(matrix * factor, DVec3::ZERO), None);
        let shear = DMat3::from_cols(DVec3::X, dvec3(factor - 1.0, 1.0, 0.0), DVec3::Z);
        prop_assert_eq!(Pose::from_matrix(matrix * shear, DVec3::ZERO), None);
    }

    #[test]
    fn similarities_come_back(
        exponent in -6.0..6.0,
        offset in prop_oneof![Just(DVec3::ZERO), vectors(1e6)],
        cameras in prop::collection::vec(vectors(1.0), 2..20),
        point in vectors(10.0),
    ) {
        let across = 10.0_f64.powf(exponent);
        let centres: Vec<DVec3> = cameras.iter().map(|c| offset + *c * across).collect();
        let similarity = Similarity::from_cameras(&centres);
        prop_assert!(similarity.is_some());
        if let Some(similarity) = similarity {
            let world = offset + point * across;
            let back = similarity.restore(similarity.normalize(world));
            // Only the rounding of world coordinates themselves may be lost.
            let unit = f64::EPSILON * (offset.length() + 20.0 * across);
            prop_assert!(back.distance(world) <= 8.0 * unit);
            for centre in &centres {
                prop_assert!(similarity.normalize(*centre).length() <= 1.0 + 1e-6);
            }
        }
    }

    #[test]
    fn normalized_cameras_reach_the_unit_sphere(
        exponent in -6.0..6.0,
        cameras in prop::collection::vec(vectors(1.0), 2..20),
    ) {
        let across = 10.0_f64.powf(exponent);
        let centres: Vec<DVec3> = cameras.iter().map(|c| *c * across).collect();
        if let Some(similarity) = Similarity::from_cameras(&centres) {
            let farthest = centres
                .iter()
                .map(|centre| similarity.normalize(*centre).length())
                .fold(0.0, f64::max);
            prop_assert!((farthest - 1.0).abs() < 1e-9, "{}", farthest);
        }
    }

    /// Cameras along a path, as in [`walk`], of which one is elsewhere.
    #[test]
    fn a_camera_far_out_changes_nothing(
        count in 5..60_usize,
        wrong in 0..60_usize,
        exponent in 3.0..9.0,
        direction in vectors(1.0),
    ) {
        prop_assume!(direction.length() > 0.1);
        let right = walk(count);
        let mut centres = right.clone();
        let wrong = wrong % (count + 1);
        centres.insert(wrong, direction.normalize() * 10.0_f64.powf(exponent));
        prop_assert_eq!(far_cameras(&centres), [wrong]);
        prop_assert_eq!(Similarity::from_most_cameras(&centres), Similarity::from_cameras(&right));
    }

    #[test]
    fn without_a_camera_far_out_all_count(
        cameras in prop::collection::vec(vectors(1.0), 1..40),
        offset in prop_oneof![Just(DVec3::ZERO), vectors(1e6)],
    ) {
        let centres: Vec<DVec3> = cameras.iter().map(|camera| offset + *camera).collect();
        if far_cameras(&centres).is_empty() {
            let all = Similarity::from_cameras(&centres);
            prop_assert_eq!(Similarity::from_most_cameras(&centres), all);
        }
    }
}

/// Returns cameras along a bent path.
fn walk(count: usize) -> Vec<DVec3> {
    let at = |n: usize| {
        let along = n as f64 / count as f64;
        dvec3(4.0 * along, (3.0 * along).sin(), 0.1 * along)
    };
    (0..count).map(at).collect()
}

#[test]
fn far_frames_are_named() {
    let mut poses: Vec<Option<Pose>> = walk(20)
        .into_iter()
        .map(|centre| Some(Pose::new(DQuat::IDENTITY, centre)))
        .collect();
    assert_eq!(far_frames(&poses), None);
    // A frame without a pose counts as a frame.
    poses[2] = None;
    for frame in [6, 13] {
        poses[frame] = Some(Pose::new(DQuat::IDENTITY, dvec3(frame as f64, 5e4, 0.0)));
    }
    let line = far_frames(&poses).unwrap_or_default();
    assert!(
        line.contains("2 of 19 frames") && line.ends_with("frames 6, 13"),
        "{line}"
    );
    assert!(!line.contains('\n'));
}

/// Turning cameras in one place show no parallax, whatever the coordinates of the place are.
#[test]
fn cameras_in_one_place_are_told() {
    let at = |centre: DVec3, turn: f64| Some(Pose::new(DQuat::from_rotation_y(turn), centre));
    for place in [DVec3::ZERO, dvec3(4e5, 5.2e6, 30.0)] {
        let mut poses: Vec<_> = (0..8).map(|n| at(place, 0.1 * f64::from(n))).collect();
        poses.push(None);
        let line = one_place(&poses).unwrap_or_default();
        assert!(line.contains("all 8 cameras"), "{line}");
        // A tenth of a unit is parallax.
        poses[3] = at(place + dvec3(0.1, 0.0, 0.0), 0.3);
        assert_eq!(one_place(&poses), None);
    }
    assert_eq!(one_place(&[at(DVec3::ZERO, 0.0), None]), None);
    assert_eq!(one_place(&[]), None);
}

/// A camera that stands for most of a clip and then walks is not wrong, and cameras in one place give no measure of
/// distance.
#[test]
fn the_end_of_a_path_still_counts() {
    let jitter = |n: usize| 1e-3 * dvec3((n as f64).sin(), (1.7 * n as f64).cos(), 0.0);
    let step = |n: usize| dvec3(0.3 * n as f64, 0.0, 0.0);
    let mut stands: Vec<DVec3> = (0..30).map(jitter).collect();
    stands.extend((1..10).map(step));
    assert!(!far_cameras(&stands).is_empty());
    let all = Similarity::from_cameras(&stands);
    assert_eq!(Similarity::from_most_cameras(&stands), all);
    let mut still = vec![dvec3(1.0, 2.0, 3.0); 30];
    still.extend((1..10).map(step));
    assert_eq!(far_cameras(&still), [0_usize; 0]);
}

#[test]
fn floats_hold_what_is_near_the_origin() {
    for (offset, scale, fits) in [
        ([0.0; 3], 1e9, true),
        ([10.0, -20.0, 30.0], 0.5, true),
        ([5e5, 5e6, 0.0], 0.2, false),
        ([4.2e6, 1.7e5, -4.8e6], 1e-6, true),
        ([3.0, 0.0, 0.0], 1e3, false),
    ] {
        let similarity = Similarity { offset, scale };
        assert_eq!(similarity.fits_f32(), fits, "{offset:?} {scale}");
    }
}

#[test]
fn unusable_rotations_are_told() {
    for rotation_wxyz in [
        [0.0; 4],
        [f64::NAN, 0.0, 0.0, 1.0],
        [f64::INFINITY, 0.0, 0.0, 0.0],
        [1e-20, 0.0, 0.0, 0.0],
    ] {
        let pose = Pose {
            rotation_wxyz,
            centre: [0.0; 3],
        };
        assert_eq!(pose.rotation(), None, "{rotation_wxyz:?}");
        assert!(!pose.is_valid());
    }
    for (w, is_unit) in [
        (1.0, true),
        (-0.991, true),
        (1.02, false),
        (f64::NAN, false),
    ] {
        let pose = Pose {
            rotation_wxyz: [w, 0.0, 0.0, 0.0],
            centre: [0.0; 3],
        };
        assert_eq!(pose.is_unit(), is_unit, "{w}");
    }
    let lost = Pose {
        rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
        centre: [0.0, f64::NAN, 0.0],
    };
    assert!(!lost.is_valid());
    assert_eq!(Pose::from_matrix(DMat3::NAN, DVec3::ZERO), None);
    assert_eq!(Pose::from_matrix(DMat3::IDENTITY, DVec3::NAN), None);
}

#[test]
fn cameras_in_one_place_give_a_finite_scale() {
    for place in [DVec3::ZERO, dvec3(1e6, -1e6, 1e6)] {
        let similarity = Similarity::from_cameras(&[place; 5]);
        assert!(similarity.is_some_and(|s| s.scale.is_finite() && s.scale > 0.0));
    }
    assert_eq!(Similarity::from_cameras(&[]), None);
    assert_eq!(Similarity::from_cameras(&[DVec3::ZERO, DVec3::NAN]), None);
}
