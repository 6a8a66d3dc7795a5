//! Activation and gradients compared with the definition in f64.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_schemas::{
    Similarity,
    trajectory::{BSpline, GroundAxes, ObjectPath},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::{
    device::test_device,
    gaussians::static_gaussians::{LOG_SCALES, QUATERNIONS, StaticGaussians},
    model::{Model, Part},
    step::gpu::activation::GpuActivator,
};

const KNOTS: usize = 3;

/// Returns two objects, a huge and a tiny one, whose headings pass pi.
fn objects() -> Vec<TrackedObject> {
    let normalization = Similarity::new([0.0; 3], 1.0);
    let object = |id: u32, size: f32, turn: f64| {
        let path = ObjectPath {
            centre: BSpline {
                degree: 3,
                knots: BSpline::uniform_knots(3, 5, 0.0, 4.0),
                coefficients: (0..5)
                    .map(|n| [f64::from(n) - 2.0, (f64::from(n) + turn).sin(), 3.0])
                    .collect(),
            },
            heading_seconds: vec![0.0, 4.0],
            headings: vec![turn, turn + 1.0],
        };
        let up = dvec3(0.2, -0.1, 1.0).normalize();
        TrackedObject {
            id,
            dimensions: [size, 0.4 * size, 0.3 * size],
            path: RigidPath::new(&path, up, 0.5 * size, KNOTS, &normalization),
        }
    };
    vec![object(7, 100.0, 2.7), object(9, 1e-3, -0.5)]
}

/// Returns a parameterization with corrections, and a table of random Gaussians in its boxes.
fn model() -> (TrackedGaussians, ParameterTable) {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let mut number = |low: f32, high: f32| random.random_range(low..high);
    let mut initial = InitialGaussians::default();
    let mut numbers = Vec::new();
    for index in 0..12 {
        numbers.push(index % 2);
        let position = [number(-0.5, 0.5), number(-0.2, 0.2), number(-0.15, 0.15)];
        initial.positions.push(position);
        initial.scales.push([number(0.02, 0.1); 3]);
        initial.rotations.push([1.0, 0.0, 0.0, 0.0]);
        initial.colours.push([0.5; 3]);
        initial.opacities.push(0.5);
    }
    let mut table = table(&initial, &numbers);
    for array in [LOG_SCALES, QUATERNIONS] {
        for value in &mut table.arrays[array].values {
            *value += number(-0.4, 0.4);
        }
    }
    let mut tracked = TrackedGaussians::new(objects(), true);
    let levers = [50.0, 5e-4];
    for (index, value) in tracked.corrections.array.values.iter_mut().enumerate() {
        *value = levers[index / (KNOTS * 4)] * number(-0.2, 0.2);
    }
    (tracked, table)
}

fn at(seconds: f64) -> Viewpoint {
    Viewpoint {
        seconds,
        shift_frames: 0.0,
        centre: Vec3::ZERO,
        down: Vec3::Y,
        scheduled: Some(1),
    }
}

/// Weights of the loss: of centre, scale and rotation of every Gaussian.
fn weights(count: usize) -> Vec<[f64; 10]> {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    (0..count)
        .map(|_| [0; 10].map(|_| random.random_range(-1.0..1.0)))
        .collect()
}

/// Returns a random linear function of the output of [`TrackedGaussians::activate`], by its definition in
/// f64. `values` are, per Gaussian, centre, log-scales and quaternion, then all corrections.
fn loss(values: &[f64], units: [f64; 2], seconds: f64, weights: &[[f64; 10]]) -> f64 {
    let (rows, corrections) = values.split_at(10 * weights.len());
    let up = dvec3(0.2, -0.1, 1.0).normalize();
    let axes = GroundAxes::new(up);
    let turns = [2.7, -0.5];
    let mut total = 0.0;
    for (index, (row, weight)) in rows.as_chunks::<10>().0.iter().zip(weights).enumerate() {
        let object = index % 2;
        let spline = BSpline {
            degree: 3,
            knots: BSpline::uniform_knots(3, 5, 0.0, 4.0),
            coefficients: (0..5)
                .map(|n| {
                    [
                        f64::from(n) - 2.0,
                        (f64::from(n) + turns[object]).sin(),
                        3.0,
                    ]
                })
                .collect(),
        };
        let knot = seconds / 4.0 * (KNOTS - 1) as f64;
        let before = (knot as usize).min(KNOTS - 2);
        let share = knot - before as f64;
        let own = &corrections[4 * KNOTS * object..];
        let value =
            |k: usize| (1.0 - share) * own[4 * before + k] + share * own[4 * before + 4 + k];
        let centre = spline.position(seconds) + dvec3(value(0), value(1), value(2));
        let lever = 0.5 * units[object];
        let heading = turns[object] + seconds / 4.0 + value(3) / lever;
        let rotation: DMat3 = axes.rotation(heading);
        let position = rotation * (DVec3::from_slice(&row[..3]) * units[object]) + centre;
        let quaternion = DQuat::from_xyzw(row[7], row[8], row[9], row[6]).normalize();
        let turned = DQuat::from_mat3(&rotation) * quaternion;
        // The kernels may use the other sign of the pose's quaternion, which flips the sign of all gradients.
        let of_pose = DQuat::from_mat3(&rotation.as_mat3().as_dmat3());
        let sign = of_pose.dot(DQuat::from_mat3(&rotation)).signum();
        // Values are in units of the object, so that both objects matter.
        for axis in 0..3 {
            total += weight[axis] * position[axis] / units[object];
            total += weight[3 + axis] * row[3 + axis].exp();
        }
        let turned = [turned.w, turned.x, turned.y, turned.z];
        for (weight, component) in weight[6..].iter().zip(turned) {
            total += weight * component * sign;
        }
    }
    total
}

#[test]
fn gradients_are_those_of_the_definition() {
    let (mut tracked, mut table) = model();
    let units = [100.0, f64::from(1e-3_f32)];
    let weights = weights(table.len());
    for seconds in [0.0, 1.1, 1.77, 2.9, 4.0] {
        let mut activated = ActivatedGaussians::default();
        activated.reshape(table.len(), 0, 0);
        tracked.activate(
            &table,
            &at(seconds),
            &TemporalFeatures::default(),
            0,
            &mut activated,
        );
        let mut values = Vec::new();
        for index in 0..table.len() {
            for array in [POSITIONS, LOG_SCALES, QUATERNIONS] {
                values.extend(
                    table
                        .row(array, index)
                        .iter()
                        .map(|&value| f64::from(value)),
                );
            }
        }
        let corrections = tracked.corrections.array.values.iter();
        values.extend(corrections.map(|&value| f64::from(value)));
        // Forward pass: the same function of the activated Gaussians.
        let mut sum = 0.0;
        let mut gradient = ActivatedGaussians::default();
        gradient.clear_to_zero(&activated);
        for (index, weight) in weights.iter().enumerate() {
            let unit = units[index % 2];
            for axis in 0..3 {
                sum += weight[axis] * f64::from(activated.positions[index][axis]) / unit;
                sum += weight[3 + axis] * f64::from(activated.scales[index][axis]) / unit;
                gradient.positions[index][axis] = (weight[axis] / unit) as f32;
                gradient.scales[index][axis] = (weight[3 + axis] / unit) as f32;
            }
            for (component, weight) in weight[6..].iter().enumerate() {
                sum += weight * f64::from(activated.rotations[index][component]);
                gradient.rotations[index][component] = *weight as f32;
            }
        }
        let expected = loss(&values, units, seconds, &weights);
        assert!(
            (sum - expected).abs() < 2e-3 * expected.abs().max(1.0),
            "{sum} {expected}"
        );
        tracked.activate_backward(
            &mut table,
            &at(seconds),
            &TemporalFeatures::default(),
            0,
            &mut activated,
            &mut gradient,
        );
        for place in 0..values.len() {
            let found = if place < 10 * table.len() {
                let (index, value) = (place / 10, place % 10);
                let (array, column) = match value {
                    0..3 => (POSITIONS, value),
                    3..6 => (LOG_SCALES, value - 3),
                    _ => (QUATERNIONS, value - 6),
                };
                let array = &table.arrays[array];
                array.gradients[index * array.width + column]
            } else {
                tracked.corrections.array.gradients[place - 10 * table.len()]
            };
            // Corrections are of the size of their object.
            let unit = match place.checked_sub(10 * table.len()) {
                Some(correction) => units[correction / (4 * KNOTS)],
                None => 1.0,
            };
            let moved = |step: f64| {
                let mut values = values.clone();
                values[place] += step * unit;
                loss(&values, units, seconds, &weights)
            };
            let by_difference = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            let found = f64::from(found) * unit;
            let error = (found - by_difference).abs();
            assert!(
                error < 1e-3 * by_difference.abs().max(1.0),
                "value {place} at {seconds} s: {found} against {by_difference}"
            );
        }
    }
}

#[test]
fn objects_are_not_there_before_and_after_their_paths() {
    let (mut tracked, mut table) = model();
    for seconds in [-0.1, 4.1, 1e9] {
        let mut activated = ActivatedGaussians::default();
        activated.reshape(table.len(), 1, 0);
        activated.sh_rest.fill([9.0; 3]);
        let none = TemporalFeatures::default();
        tracked.activate(&table, &at(seconds), &none, 0, &mut activated);
        assert!(activated.opacities.iter().all(|&opacity| opacity == 0.0));
        assert!(activated.sh_rest.iter().all(|rest| *rest == [0.0; 3]));
        let mut gradient = activated.clone();
        for by in &mut gradient.positions {
            *by = [1.0; 3];
        }
        tracked.activate_backward(
            &mut table,
            &at(seconds),
            &none,
            0,
            &mut activated,
            &mut gradient,
        );
        let gradients = table.arrays.iter().flat_map(|array| &array.gradients);
        assert!(
            gradients
                .chain(&tracked.corrections.array.gradients)
                .all(|&by| by == 0.0)
        );
    }
}

#[test]
fn after_a_step_all_is_in_its_box_and_no_mean_correction_is_left() {
    let (mut tracked, mut table) = model();
    table.arrays[POSITIONS].values.fill(3.0);
    tracked.keep_within_bounds(&mut table);
    for index in 0..table.len() {
        let row = table.row(POSITIONS, index);
        assert!(
            row.iter()
                .zip([0.55, 0.22, 0.165])
                .all(|(value, limit)| (value - limit).abs() < 1e-6)
        );
    }
    for object in tracked.corrections.array.values.chunks(4 * KNOTS) {
        let scale = object
            .iter()
            .fold(0.0_f32, |most, value| most.max(value.abs()));
        for component in 0..4 {
            let sum: f32 = object.iter().skip(component).step_by(4).sum();
            assert!(sum.abs() <= 1e-6 * scale, "{sum} of {scale}");
        }
    }
}

/// An object at a pose is drawn as the same Gaussians placed there by hand.
#[test]
fn activated_gaussians_are_those_placed_by_hand() {
    let (mut tracked, table) = model();
    let mut activated = ActivatedGaussians::default();
    activated.reshape(table.len(), 0, 0);
    tracked.activate(
        &table,
        &at(1.3),
        &TemporalFeatures::default(),
        0,
        &mut activated,
    );
    let poses = tracked.poses(1.3);
    let mut own = ActivatedGaussians::default();
    static_gaussians::activate(&table, &mut own);
    for (index, number) in tracked.numbers(&table).enumerate() {
        let (unit, pose) = (
            tracked.objects[number].unit(),
            poses[number].expect("there"),
        );
        let position =
            pose.rotation * (Vec3::from_array(own.positions[index]) * unit) + pose.centre;
        assert_eq!(activated.positions[index], position.to_array());
        assert_eq!(
            activated.scales[index],
            own.scales[index].map(|side| side * unit)
        );
        assert_eq!(activated.opacities[index], own.opacities[index]);
        assert_eq!(activated.sh_constant[index], own.sh_constant[index]);
    }
    assert_eq!(tracked.ids(&table)[..3], [7, 9, 7]);
}

/// Returns the objects after static Gaussians with harmonics, which the objects lack.
fn beside_static_ones(refines_poses: bool) -> Model {
    let (mut tracked, table) = model();
    tracked.refines_poses = refines_poses;
    let mut initial = InitialGaussians::default();
    for place in 0..5 {
        initial.push_isotropic([place as f32, 1.0, -1.0], 0.1, [0.4; 3], 0.6);
    }
    let fixed = static_gaussians::table(&initial, 1);
    Model::new(vec![
        Part::new(StaticGaussians, fixed),
        Part::new(tracked, table),
    ])
}

/// Asserts that the values of an object differ by little of their typical size.
fn assert_near(what: &str, found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let squares: f32 = expected.iter().map(|value| value * value).sum();
    let typical = (squares / expected.len().max(1) as f32).sqrt();
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        let allowed = 1e-3 * expected.abs().max(typical);
        assert!(
            error <= allowed,
            "{what}[{index}]: {found} against {expected}"
        );
    }
}

/// Returns every second row, beginning with `object`: those of one object.
fn of_object(values: &[f32], width: usize, object: usize) -> Vec<f32> {
    let rows = values.chunks(width).skip(object).step_by(2);
    rows.flatten().copied().collect()
}

#[test]
fn the_gpu_places_objects_and_finds_gradients_as_the_cpu_does() {
    let Some(gpu) = test_device() else { return };
    let activator = GpuActivator::new(Arc::new(gpu)).expect("compiles");
    let none = TemporalFeatures::default();
    for (refines_poses, seconds) in [
        (true, 0.0),
        (true, 1.77),
        (false, 2.9),
        (true, 4.0),
        (true, 4.1),
    ] {
        let mut on_cpu = beside_static_ones(refines_poses);
        let at = at(seconds);
        let (mut expected, mut by) = (ActivatedGaussians::default(), ActivatedGaussians::default());
        on_cpu.activate(&at, &none, &mut expected);
        let mut on_gpu = activator
            .activation(beside_static_ones(refines_poses), &at)
            .expect("fits");
        let found = on_gpu.activate().expect("runs");
        assert_eq!(found.sh_rest, expected.sh_rest);
        assert_eq!(found.opacities[5..] == [0.0; 12], seconds > 4.0);
        by.clear_to_zero(&expected);
        for (entry, weights) in weights(by.len()).iter().enumerate() {
            let [a, b, c, d, e, f, rest @ ..] = weights.map(|weight| weight as f32);
            by.positions[entry] = [a, b, c];
            by.scales[entry] = [d, e, f];
            by.rotations[entry] = rest;
            by.opacities[entry] = a;
            by.sh_constant[entry] = [b, c, d];
        }
        // The quaternions of both signs are one rotation.
        let mut by_found = by.clone();
        let mut rotations = found.rotations.clone();
        for (entry, rotation) in rotations.iter_mut().enumerate() {
            let pairs = rotation.iter().zip(&expected.rotations[entry]);
            let sign = pairs.map(|(a, b)| a * b).sum::<f32>().signum();
            *rotation = rotation.map(|value| sign * value);
            by_found.rotations[entry] = by.rotations[entry].map(|value| sign * value);
        }
        for object in 0..2 {
            let what = format!("object {object} at {seconds} s");
            for (found, expected, width) in [
                (
                    found.positions.as_flattened(),
                    expected.positions.as_flattened(),
                    3,
                ),
                (
                    found.scales.as_flattened(),
                    expected.scales.as_flattened(),
                    3,
                ),
                (
                    rotations.as_flattened(),
                    expected.rotations.as_flattened(),
                    4,
                ),
                (&found.opacities[..], &expected.opacities[..], 1),
            ] {
                let own = |values: &[f32]| of_object(&values[5 * width..], width, object);
                assert_near(&what, &own(found), &own(expected));
            }
        }
        on_cpu.activate_backward(&at, &none, &mut expected, &mut by);
        let with_gradients = on_gpu.activate_backward(&by_found).expect("runs");
        let parts = [with_gradients, &on_cpu].map(|model| &model.parts[1]);
        let [of_gpu, of_cpu] = parts.map(|part| &part.table.arrays);
        for object in 0..2 {
            for (gpu, cpu) in of_gpu
                .iter()
                .zip(of_cpu)
                .filter(|(gpu, _)| !gpu.is_frozen())
            {
                let what = format!("{} of object {object} at {seconds} s", gpu.name);
                let own = |values: &[f32]| of_object(values, gpu.width, object);
                assert_near(&what, &own(&gpu.gradients), &own(&cpu.gradients));
            }
            if refines_poses {
                let own = KNOTS * 4 * object..KNOTS * 4 * (object + 1);
                let shared = parts.map(|part| part.parameterization.shared().expect("poses"));
                let [gpu, cpu] = shared.map(|shared| &shared.array.gradients[own.clone()]);
                assert_near("poses", gpu, cpu);
            }
        }
    }
}

/// Objects may be there in a part of the clip alone.
#[test]
fn a_model_lasts_as_long_as_its_clip() {
    let (tracked, table) = model();
    let mut model = Model::new(vec![Part::new(tracked, table)]);
    let span = |model: &Model| {
        let span = model.time_span().expect("objects move");
        ([span.begin_seconds, span.end_seconds], span.frames)
    };
    assert_eq!(span(&model), ([0.0, 4.0], None));
    model.clip = Some(TimeSpan {
        begin_seconds: -2.0,
        end_seconds: 3.0,
        frames: Some(11),
    });
    assert_eq!(span(&model), ([-2.0, 4.0], Some(11)));
    model.parts.clear();
    assert_eq!(model.time_span(), None);
}
