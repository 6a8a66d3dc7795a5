//! Gradients of objects, planes, spheres, layers, splines, hash grids, scaffolds and dropout, against five-point
//! differences in f64.

mod objects;
mod scaffold;

use glam::{DMat3, DVec2, DVec3};
use omnilife_engine::{
    fields::hash_grid::{
        HashGrid, HashGridShape,
        levels::{FEATURES, Level},
    },
    gaussians::{ActivatedGaussians, dropout::Dropout},
    surfaces::{
        compose::{Layer, compose, compose_vjp},
        plane::{self, Ray},
        sphere::{self, Sphere},
        view_angle::{view_angle, view_angle_vjp},
    },
    trajectories::{
        catmull_rom::Knots,
        rigid_spline::RigidPose,
        rotation_spline::{rotation_of_vectors, rotation_of_vectors_vjp},
    },
};

use crate::{
    devices::Device,
    largest_or_nan,
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};

/// Limit of gradients computed in f64: ten times the error of five-point differences.
const EXACT: f64 = 5e-11;

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "object-gradients",
        title: "gradients of an object as large as the scene, whose heading passes pi",
        runs: Runs::OnBoth,
        judge: |device| objects::judge(device, 1.0, 2e-6),
    },
    SpecialCase {
        id: "object-gradients-large",
        title: "gradients of an object a million times as large as the scene",
        runs: Runs::OnBoth,
        judge: |device| objects::judge(device, 1e6, 2e-6),
    },
    SpecialCase {
        id: "object-gradients-small",
        title: "gradients of an object a thousandth as large as the scene",
        // The distance from its centre has three digits fewer.
        runs: Runs::OnBoth,
        judge: |device| objects::judge(device, 1e-3, 1e-5),
    },
    SpecialCase {
        id: "plane-gradients",
        title: "gradients of a hit by ray and pose, of a tilted plane",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| plane_gradients(0.7, EXACT),
    },
    SpecialCase {
        id: "plane-gradients-grazing",
        title: "gradients of a hit by ray and pose, of a plane with a cosine of a hundredth",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| plane_gradients(std::f64::consts::FRAC_PI_2 - 0.01, EXACT),
    },
    SpecialCase {
        id: "sphere-gradients",
        title: "gradients of a hit on the sphere of the background by the ray",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| sphere_gradients(),
    },
    SpecialCase {
        id: "angle-gradients",
        title: "gradients of view angles from a thousandth of a radian to almost pi",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| angle_gradients(),
    },
    SpecialCase {
        id: "layer-gradients",
        title: "gradients of composed layers by colour and opacity, behind an opaque one too",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| layer_gradients(),
    },
    SpecialCase {
        id: "spline-gradients",
        title: "gradients of a spline of rotations by its knots, within and beyond them",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| spline_gradients(0.4),
    },
    SpecialCase {
        id: "spline-gradients-turned",
        title: "gradients of a spline of rotations whose knots are far apart",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| spline_gradients(1.3),
    },
    SpecialCase {
        id: "hash-gradients",
        title: "gradients of a hash grid by table and position",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| hash_gradients(),
    },
    SpecialCase {
        id: "scaffold-gradients",
        title: "gradients of the loss on a scaffold by the centres, within and beyond half a voxel",
        runs: Runs::OnBoth,
        judge: scaffold::judge,
    },
    SpecialCase {
        id: "dropout-gradients",
        title: "gradients of opacities where 99 of 100 Gaussians are dropped",
        runs: Runs::OnBoth,
        judge: dropout_gradients,
    },
];

/// Returns the five-point difference of a function at 0.
fn difference(value: impl Fn(f64) -> f64, step: f64) -> f64 {
    let near = value(step) - value(-step);
    let far = value(2.0 * step) - value(-2.0 * step);
    (8.0 * near - far) / (12.0 * step)
}

/// Returns the largest difference of derivatives, relative to the largest expected one.
fn relative_error(pairs: &[[f64; 2]]) -> f64 {
    let largest = pairs.iter().map(|pair| pair[1].abs()).fold(0.0, f64::max);
    let errors = pairs
        .iter()
        .map(|[found, expected]| (found - expected).abs());
    errors.fold(0.0, largest_or_nan) / largest.max(f64::MIN_POSITIVE)
}

fn judged(error: f64, limit: f64) -> CaseResult {
    CaseResult::of_errors(
        "compared with differences in f64",
        None,
        Some([error, limit]),
    )
}

fn plane_gradients(turn: f64, limit: f64) -> CaseResult {
    let ray = Ray {
        origin: DVec3::new(0.02, -0.05, 0.1),
        direction: DVec3::Z,
    };
    let pose = RigidPose {
        centre: DVec3::new(0.1, -0.1, 2.0),
        rotation: DMat3::from_rotation_y(turn) * DMat3::from_rotation_z(0.3),
    };
    let size = DVec2::new(30.0, 20.0);
    let (by_uv, by_direction) = (DVec2::new(0.7, -0.4), DVec3::new(0.2, -0.6, 0.3));
    let value = |ray: &Ray, pose: &RigidPose| {
        plane::hit(ray, pose, size).map_or(f64::NAN, |hit| {
            by_uv.dot(hit.uv) + by_direction.dot(hit.direction)
        })
    };
    let Some(hit) = plane::hit(&ray, &pose, size) else {
        return CaseResult::failed("the plane is missed".to_owned());
    };
    let gradient = plane::hit_vjp(&ray, &pose, size, &hit, by_uv, by_direction);
    let by_pose = gradient.pose();
    let step = 1e-5;
    let mut pairs = Vec::new();
    for axis in 0..3 {
        let along = DVec3::AXES[axis];
        let moved = |shift: f64| {
            let origin = ray.origin + shift * along;
            value(&Ray { origin, ..ray }, &pose)
        };
        pairs.push([gradient.ray.origin[axis], difference(moved, step)]);
        let turned = |shift: f64| {
            let direction = ray.direction + shift * along;
            value(&Ray { direction, ..ray }, &pose)
        };
        pairs.push([gradient.ray.direction[axis], difference(turned, step)]);
        let moved = |shift: f64| {
            let centre = pose.centre + shift * along;
            value(&ray, &RigidPose { centre, ..pose })
        };
        pairs.push([by_pose.centre[axis], difference(moved, step)]);
        for column in 0..3 {
            let turned = |shift: f64| {
                let mut pose = pose;
                pose.rotation.col_mut(column)[axis] += shift;
                value(&ray, &pose)
            };
            let found = by_pose.rotation.col(column)[axis];
            pairs.push([found, difference(turned, step)]);
        }
    }
    judged(relative_error(&pairs), limit)
}

fn sphere_gradients() -> CaseResult {
    let sphere = Sphere {
        centre: DVec3::new(0.1, 0.2, -0.1),
        radius: 3.0,
    };
    let by_normal = DVec3::new(0.7, -0.4, 0.5);
    let mut pairs = Vec::new();
    for direction in [DVec3::new(0.3, -0.2, 0.9), DVec3::new(-0.5, 0.4, -0.7)] {
        let ray = Ray {
            origin: DVec3::new(1.5, -0.8, 1.2),
            direction: direction.normalize(),
        };
        let Some(hit) = sphere::hit(&ray, &sphere) else {
            return CaseResult::failed("the sphere is missed".to_owned());
        };
        let gradient = sphere::hit_vjp(&ray, &sphere, &hit, by_normal);
        let value =
            |ray: &Ray| sphere::hit(ray, &sphere).map_or(f64::NAN, |hit| by_normal.dot(hit.normal));
        for along in DVec3::AXES {
            let moved = |shift: f64| {
                let origin = ray.origin + shift * along;
                value(&Ray { origin, ..ray })
            };
            pairs.push([gradient.origin.dot(along), difference(moved, 1e-4)]);
            // Directions keep their length.
            let across = along - along.dot(ray.direction) * ray.direction;
            let turned = |shift: f64| {
                let direction = (ray.direction + shift * across).normalize();
                value(&Ray { direction, ..ray })
            };
            pairs.push([gradient.direction.dot(across), difference(turned, 1e-4)]);
        }
    }
    judged(relative_error(&pairs), EXACT)
}

fn angle_gradients() -> CaseResult {
    let by_angle = DVec2::new(0.6, -0.8);
    let errors = [1e-3, 0.3, 1.5, 3.0].map(|angle: f64| {
        let direction = DVec3::new(0.6 * angle.sin(), 0.8 * angle.sin(), angle.cos());
        let found = view_angle_vjp(direction, by_angle);
        let pairs = DVec3::AXES.map(|along| {
            let value = |shift: f64| by_angle.dot(view_angle(direction + shift * along));
            [found.dot(along), difference(value, 1e-3 * angle.sin())]
        });
        relative_error(&pairs)
    });
    judged(errors.into_iter().fold(0.0, largest_or_nan), EXACT)
}

fn layer_gradients() -> CaseResult {
    let upstream = DVec3::new(0.3, -0.5, 0.8);
    let layers: Vec<Layer> = [0.4, 0.0, 0.7, 1.0 - 1e-7, 1.0, 0.2]
        .into_iter()
        .enumerate()
        .map(|(surface, opacity)| Layer {
            distance: 1.0 + surface as f64,
            surface,
            colour: DVec3::new(0.1, 0.5, 0.9) * (1.0 - 0.1 * surface as f64),
            opacity,
        })
        .collect();
    let mut gradients = Vec::new();
    compose_vjp(&layers, upstream, &mut gradients);
    let mut pairs = Vec::new();
    for (at, gradient) in gradients.iter().enumerate() {
        let with = |change: &dyn Fn(&mut Layer)| {
            let mut layers = layers.clone();
            change(&mut layers[at]);
            upstream.dot(compose(&layers))
        };
        // The image is linear in every colour and every opacity.
        let by_opacity = with(&|layer| layer.opacity = 1.0) - with(&|layer| layer.opacity = 0.0);
        pairs.push([gradient.opacity, by_opacity]);
        for axis in 0..3 {
            let by_colour =
                with(&|layer| layer.colour[axis] = 1.0) - with(&|layer| layer.colour[axis] = 0.0);
            pairs.push([gradient.colour[axis], by_colour]);
        }
    }
    judged(relative_error(&pairs), 3e-15)
}

fn spline_gradients(turn: f64) -> CaseResult {
    let knots = Knots::with_neighbours(4);
    let vectors: Vec<DVec3> = (0..knots.count)
        .map(|knot| {
            let phase = 1.7 * knot as f64;
            turn * DVec3::new(phase.sin(), (1.3 * phase).cos(), (0.6 * phase).sin())
        })
        .collect();
    let upstream = DMat3::from_cols_array(&[0.3, -0.7, 0.2, 0.9, 0.1, -0.4, -0.6, 0.5, 0.8]);
    let value = |vectors: &[DVec3], time: f64| {
        let matrix = DMat3::from_quat(rotation_of_vectors(&knots, vectors, 0.5, time).normalize());
        (0..3)
            .map(|column| upstream.col(column).dot(matrix.col(column)))
            .sum::<f64>()
    };
    let mut pairs = Vec::new();
    for time in [-0.5, -0.1, 0.0, 0.21, 0.5, 0.93, 1.0, 1.5] {
        let mut gradients = vec![DVec3::ZERO; knots.count];
        rotation_of_vectors_vjp(&knots, &vectors, 0.5, time, upstream, &mut gradients);
        for (knot, gradient) in gradients.iter().enumerate() {
            for axis in 0..3 {
                let moved = |shift: f64| {
                    let mut vectors = vectors.clone();
                    vectors[knot][axis] += shift;
                    value(&vectors, time)
                };
                pairs.push([gradient[axis], difference(moved, 1e-4)]);
            }
        }
    }
    judged(relative_error(&pairs), EXACT)
}

/// Returns the corners of a level's cell around a position with their weights, in f64.
fn corners(level: &Level, position: [f64; 2]) -> [(usize, f64); 4] {
    let at = position.map(|value| value.clamp(0.0, 1.0) * f64::from(level.scale) + 0.5);
    let first = at.map(f64::floor);
    std::array::from_fn(|bits| {
        let upper = [bits & 1, bits >> 1];
        let corner = [0, 1].map(|axis: usize| first[axis] as u32 + upper[axis] as u32);
        let weight = |axis: usize| {
            let fraction = at[axis] - first[axis];
            if upper[axis] == 1 {
                fraction
            } else {
                1.0 - fraction
            }
        };
        let entry = level.first_entry + level.entry(corner) as usize;
        (entry, weight(0) * weight(1))
    })
}

fn hash_gradients() -> CaseResult {
    let grid = HashGrid::new(HashGridShape::new(2, 6, 9));
    let table: Vec<f32> = (0..grid.parameter_count())
        .map(|at| (0.37 * at as f32).sin())
        .collect();
    let positions: Vec<f32> = (0..40)
        .map(|at| 0.5 + 0.45 * (2.1 * at as f32 + 0.3).sin())
        .collect();
    let upstream: Vec<f32> = (0..20 * grid.features())
        .map(|at| (0.71 * at as f32).cos())
        .collect();
    let mut found = vec![0.0; table.len()];
    grid.backward_table(&positions, usize::MAX, &upstream, &mut found);
    let rows = || {
        let positions = positions.as_chunks::<2>().0.iter();
        positions.zip(upstream.chunks_exact(grid.features()))
    };
    let mut expected = vec![0.0; table.len()];
    for (position, upstream) in rows() {
        for (level, upstream) in grid.levels.iter().zip(upstream.chunks_exact(FEATURES)) {
            for (entry, weight) in corners(level, position.map(f64::from)) {
                for (feature, &by) in upstream.iter().enumerate() {
                    expected[FEATURES * entry + feature] += weight * f64::from(by);
                }
            }
        }
    }
    let pairs: Vec<[f64; 2]> = found
        .iter()
        .zip(&expected)
        .map(|(&found, &expected)| [f64::from(found), expected])
        .collect();
    let by_table = relative_error(&pairs);
    let mut pairs = Vec::new();
    for (position, upstream) in rows() {
        let mut found = [0.0; 2];
        grid.backward_position(position, &table, usize::MAX, upstream, &mut found);
        let value = |position: [f64; 2]| -> f64 {
            let levels = grid.levels.iter().zip(upstream.chunks_exact(FEATURES));
            let of_level = |(level, upstream): (&Level, &[f32])| -> f64 {
                let of_corner = |(entry, weight): (usize, f64)| {
                    let row = table[FEATURES * entry..].iter().zip(upstream);
                    weight * row.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>()
                };
                corners(level, position).map(of_corner).iter().sum()
            };
            levels.map(of_level).sum()
        };
        for axis in 0..2 {
            // A step is far below a cell: features are linear along it.
            let moved = |shift: f64| {
                let mut position = position.map(f64::from);
                position[axis] += shift;
                value(position)
            };
            pairs.push([f64::from(found[axis]), difference(moved, 1e-7)]);
        }
    }
    judged(by_table.max(relative_error(&pairs)), 2e-5)
}

fn dropout_gradients(device: &Device) -> CaseResult {
    const COUNT: usize = 5_000;
    let dropout = Dropout {
        last_share: 0.99,
        iterations: 100,
        seed: 5,
    };
    let before: Vec<f32> = (0..COUNT).map(|at| 0.01 + 1e-4 * at as f32).collect();
    let upstream: Vec<f32> = (0..COUNT).map(|at| (0.3 * at as f32).sin()).collect();
    let mut gaussians = ActivatedGaussians::default();
    gaussians.reshape(COUNT, 0, 0);
    gaussians.opacities.clone_from(&before);
    let mut gradient = ActivatedGaussians::default();
    gradient.reshape(COUNT, 0, 0);
    gradient.opacities.clone_from(&upstream);
    let drawn = match device.drop_out(dropout, 100, [&mut gaussians, &mut gradient]) {
        Ok(drawn) => drawn,
        Err(error) => return CaseResult::failed(error),
    };
    // The drawn opacity is proportional to the stored one.
    let pairs: Vec<[f64; 2]> = (0..COUNT)
        .map(|at| {
            let factor = f64::from(drawn[at]) / f64::from(before[at]);
            [
                f64::from(gradient.opacities[at]),
                factor * f64::from(upstream[at]),
            ]
        })
        .collect();
    let restored = drawn
        .iter()
        .zip(before.iter().zip(&gaussians.opacities))
        .filter(|(drawn, _)| **drawn > 0.0)
        .map(|(_, (before, after))| f64::from((before - after).abs()))
        .fold(0.0, largest_or_nan);
    CaseResult::of_errors(
        "the gradient is that by the opacities before, which come back",
        Some([restored, device.limit(3e-7)]),
        Some([relative_error(&pairs), device.limit(6e-7)]),
    )
}
