//! Splines compared with golden values, central differences and curves that they must reproduce.

use glam::{DMat3, DQuat, DVec3};

use super::{
    catmull_rom::{Knots, fit_positions},
    rigid_spline::{PoseGradient, RigidOffsets, RigidSpline},
    rotation_spline::{fit_rotations, rotation},
};
use crate::golden_tests::{golden, numbers, vector};

fn time(case: &serde_json::Value) -> f64 {
    case["time"].as_f64().expect("a time")
}

#[test]
fn positions_are_golden() {
    let knots = [[0., 0., 0.], [1., 2., 0.], [3., 1., 1.], [4., 4., 2.]].map(DVec3::from_array);
    let spline = golden()["spline"].as_array().expect("cases");
    for case in spline {
        let found = Knots::unit(4).position(&knots, time(case));
        assert!((found - vector(&case["position"])).length() < 1e-12);
    }
    let offsets = [
        [0.2, 0., 0.],
        [0.1, 0.3, 0.],
        [-0.2, 0.1, 0.4],
        [0., 0., 0.1],
        [0.3, -0.1, 0.],
    ]
    .map(DVec3::from_array);
    for case in golden()["offset_spline"].as_array().expect("cases") {
        let found = Knots::with_neighbours(3).position(&offsets, time(case));
        assert!((found - vector(&case["position"])).length() < 1e-12);
    }
}

fn turns() -> Vec<DQuat> {
    [[0., 0., 0.], [0.3, 0., 0.], [0.3, 0.5, 0.], [0., 0.5, 0.7]]
        .map(|v| DQuat::from_scaled_axis(DVec3::from_array(v)))
        .to_vec()
}

#[test]
fn rotations_are_golden_whatever_the_sign_of_a_knot() {
    let signs: Vec<DQuat> = turns()
        .iter()
        .enumerate()
        .map(|(at, &q)| if at % 2 == 1 { -q } else { q })
        .collect();
    for case in golden()["rotation_spline"].as_array().expect("cases") {
        let expected = DQuat::from_slice(&numbers(&case["rotation"]));
        let found = rotation(&Knots::unit(4), &turns(), time(case));
        assert!((found - expected).length() < 1e-12, "{found} {expected}");
        let other = rotation(&Knots::unit(4), &signs, time(case));
        assert!((other.dot(expected).abs() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn constant_velocity_is_reproduced_within_and_beyond_the_knots() {
    let times = (0..29).map(|step| -0.2 + 0.05 * f64::from(step));
    let velocity = DVec3::new(1.0, -2.0, 3.0);
    for count in [2, 3, 5] {
        let knots = Knots::unit(count);
        let line: Vec<DVec3> = (0..count).map(|k| knots.time(k) * velocity).collect();
        let steady: Vec<DQuat> = (0..count)
            .map(|k| DQuat::from_rotation_y(1.2 * knots.time(k)))
            .collect();
        for time in times.clone() {
            assert!((knots.position(&line, time) - time * velocity).length() < 1e-12);
            let found = rotation(&knots, &steady, time);
            let expected = DQuat::from_rotation_y(1.2 * time);
            assert!((found.dot(expected).abs() - 1.0).abs() < 1e-12);
        }
    }
    let one = Knots::unit(1);
    assert_eq!(one.position(&[velocity], 7.0), velocity);
    assert_eq!(rotation(&one, &[DQuat::IDENTITY], 7.0), DQuat::IDENTITY);
}

/// Half turns between knots, and no turn at all, must give finite values.
#[test]
fn half_turns_are_finite() {
    let half = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    for knots in [
        vec![DQuat::IDENTITY, half],
        vec![DQuat::IDENTITY, half, DQuat::IDENTITY],
        vec![DQuat::IDENTITY; 4],
    ] {
        for step in 0..=10 {
            let time = f64::from(step) / 10.0;
            let found = rotation(&Knots::unit(knots.len()), &knots, time);
            assert!(found.is_finite() && (found.length() - 1.0).abs() < 1e-12);
        }
    }
}

fn wavy(count: usize, phase: f64) -> Vec<DVec3> {
    let component = |at: usize| (1.3 * at as f64 + phase).sin();
    (0..count)
        .map(|k| DVec3::new(component(3 * k), component(3 * k + 1), component(3 * k + 2)))
        .collect()
}

#[test]
fn gradients_by_offsets_are_central_differences() {
    for count in [1, 2, 3, 4, 7] {
        let spline = RigidSpline {
            positions: wavy(count, 0.1),
            rotations: wavy(count, 0.5)
                .into_iter()
                .map(DQuat::from_scaled_axis)
                .collect(),
        };
        let inner = RigidOffsets::zero(count, 1.0).positions.len();
        let upstream = PoseGradient {
            centre: DVec3::new(0.3, -0.5, 0.8),
            rotation: DMat3::from_cols_array(&[0.1, 0.7, -0.3, 0.2, -0.9, 0.4, 0.5, 0.6, -0.8]),
        };
        // Training starts with offsets of 0.
        for size in [0.0, 1.0] {
            let positions: Vec<DVec3> = wavy(inner, 0.9).iter().map(|&v| size * v).collect();
            let vectors: Vec<DVec3> = wavy(inner, 1.7).iter().map(|&v| size * v).collect();
            let value = |positions: &[DVec3], vectors: &[DVec3], time: f64| {
                let offsets = RigidOffsets {
                    unit: 0.7,
                    positions: positions.to_vec(),
                    vectors: vectors.to_vec(),
                };
                let pose = offsets.applied(&spline.pose(time), time);
                let by_column = (0..3).map(|c| upstream.rotation.col(c).dot(pose.rotation.col(c)));
                upstream.centre.dot(pose.centre) + by_column.sum::<f64>()
            };
            for time in [-0.1, 0.0, 0.24, 0.5, 1.0, 1.3] {
                let mut by_positions = vec![DVec3::ZERO; inner];
                let mut by_vectors = vec![DVec3::ZERO; inner];
                let gradients = [&mut by_positions[..], &mut by_vectors[..]];
                let offsets = RigidOffsets {
                    unit: 0.7,
                    positions: positions.clone(),
                    vectors: vectors.clone(),
                };
                offsets.applied_vjp(&spline.pose(time), time, &upstream, gradients);
                for knot in 0..inner {
                    for axis in 0..3 {
                        let shifted = |values: &[DVec3], step: f64| {
                            let mut values = values.to_vec();
                            values[knot][axis] += step;
                            values
                        };
                        let by = |step| value(&shifted(&positions, step), &vectors, time);
                        let expected = (by(1e-6) - by(-1e-6)) / 2e-6;
                        assert!((by_positions[knot][axis] - expected).abs() < 1e-7);
                        let by = |step| value(&positions, &shifted(&vectors, step), time);
                        let expected = (by(1e-6) - by(-1e-6)) / 2e-6;
                        let found = by_vectors[knot][axis];
                        assert!(
                            (found - expected).abs() < 1e-7,
                            "{count} {size} {time} {knot} {axis}: {found} {expected}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_fit_returns_the_spline_that_samples_were_taken_of() {
    let knots = Knots::unit(5);
    let positions = wavy(5, 0.4);
    let rotations: Vec<DQuat> = wavy(5, 0.2)
        .into_iter()
        .map(|v| DQuat::from_scaled_axis(0.3 * v))
        .collect();
    let times = || (0..40).map(|step| f64::from(step) / 39.0);
    let samples: Vec<_> = times()
        .map(|t| (t, knots.position(&positions, t)))
        .collect();
    for (found, expected) in fit_positions(knots, &samples).iter().zip(&positions) {
        assert!((*found - *expected).length() < 1e-2, "{found} {expected}");
    }
    let samples: Vec<_> = times()
        .map(|t| (t, rotation(&knots, &rotations, t)))
        .collect();
    let found = fit_rotations(knots, &samples);
    for (time, expected) in samples {
        let error = rotation(&knots, &found, time).angle_between(expected);
        assert!(error < 1e-2, "{time}: {error}");
    }
    // One sample determines a constant.
    let found = fit_positions(Knots::unit(2), &[(0.5, DVec3::X)]);
    assert!((0.5 * (found[0] + found[1]) - DVec3::X).length() < 1e-9);
}
