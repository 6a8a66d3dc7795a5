//! Pixels with distances as Gaussians on surfaces, in a room in closed form.

use std::f64::consts::PI;

use crate::depth::room::{self, RoomView};
use glam::{DVec3, Quat, Vec3};
use omnilife_reconstruct::seeds::depth::{
    DistanceView, LiftSettings, SurfaceSamples, lift,
    normals::{relative_noise, window},
};
use omnilife_schemas::{camera::PinholeCamera, distances::DistanceImage, records::DistanceGrid};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

fn lifted(view: &RoomView, distances: &DistanceImage, mask: Option<&[u8]>) -> SurfaceSamples {
    let given = DistanceView {
        view: &view.view,
        pixels: &view.pixels,
        mask,
        ignored: None,
        distances,
        confidences: None,
    };
    lift(&given, 0, &LiftSettings::OF_BEST_VIEWS)
}

fn place(lifted: &SurfaceSamples, index: usize) -> DVec3 {
    Vec3::from_array(lifted.gaussians.positions[index]).as_dvec3()
}

/// Returns the value that `share` of the values are below.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

fn errors_metres(lifted: &SurfaceSamples) -> Vec<f64> {
    let indices = 0..lifted.len();
    indices
        .map(|index| room::signed_distance(place(lifted, index)).abs())
        .collect()
}

#[test]
fn samples_lie_on_the_surfaces_on_every_grid() {
    let view = room::view(1, 512);
    let exact = errors_metres(&lifted(&view, &view.distances, None));
    assert!(quantile(exact, 1.0) < 1e-4);
    // A file of the width 1024 at 512, and the grid with ends.
    let finer = room::view(1, 1024).distances.resampled(512, 256);
    let resampled = errors_metres(&lifted(&view, &finer, None));
    assert!(quantile(resampled.clone(), 0.5) < 5e-5);
    assert!(quantile(resampled, 0.98) < 3e-4);
    let ends = endpoint_distances(&view, 1024).brought_from(DistanceGrid::Endpoint);
    let brought = errors_metres(&lifted(&view, &ends.resampled(512, 256), None));
    // Resampling twice between pixels has twice the error at corners of walls and at edges.
    assert!(quantile(brought.clone(), 0.5) < 5e-5);
    assert!(
        quantile(brought.clone(), 0.95) < 3e-4,
        "{}",
        quantile(brought, 0.95)
    );
    let misread = errors_metres(&lifted(&view, &endpoint_distances(&view, 512), None));
    assert!(quantile(misread, 0.5) > 1e-3, "the grids differ");
}

/// Returns distances on the grid of PanoGS, Eq. 4.
fn endpoint_distances(view: &RoomView, width: usize) -> DistanceImage {
    let height = width / 2;
    let value = |at: usize| {
        let theta = 2.0 * PI * (at % width) as f64 / (width - 1) as f64 - PI;
        let phi = PI / 2.0 - PI * (at / width) as f64 / (height - 1) as f64;
        let ray = DVec3::new(phi.cos() * theta.sin(), -phi.sin(), phi.cos() * theta.cos());
        room::trace(view.centre, view.to_world * ray).distance as f32
    };
    DistanceImage {
        width,
        height,
        wraps: true,
        values: (0..width * height).map(value).collect(),
    }
}

fn normal_errors_degrees(view: &RoomView, lifted: &SurfaceSamples) -> Vec<f64> {
    (0..lifted.len())
        .map(|index| {
            let truth = view.normals[lifted.pixels[index] as usize];
            let found = lifted.normals[index].as_dvec3();
            assert!(
                found.dot(view.centre - place(lifted, index)) > 0.0,
                "faces the camera"
            );
            found.angle_between(truth).to_degrees()
        })
        .collect()
}

#[test]
fn normals_are_as_good_as_the_noise_lets_them_be() {
    let view = room::view(2, 512);
    let clean = normal_errors_degrees(&view, &lifted(&view, &view.distances, None));
    assert!(quantile(clean.clone(), 0.5) < 1.0);
    assert!(quantile(clean, 0.9) < 3.0);
    for (noise, seed) in [(2e-3_f64, 3), (1e-2, 4)] {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut noisy = view.distances.clone();
        for value in &mut noisy.values {
            let normal: f32 = StandardNormal.sample(&mut random);
            *value *= 1.0 + noise as f32 * normal;
        }
        let found = relative_noise(&noisy);
        assert!((found / noise - 1.0).abs() < 0.15, "{found} {noise}");
        let k = window(found, 256) as f64;
        let sum = (2.0 * k + 1.0).powi(2) * k * (k + 1.0) / 3.0;
        let predicted = (noise / (PI / 256.0 * sum.sqrt())).to_degrees();
        let median = quantile(
            normal_errors_degrees(&view, &lifted(&view, &noisy, None)),
            0.5,
        );
        assert!(
            (0.5 * predicted..1.3 * predicted).contains(&median),
            "{noise}: {median} degrees, predicted {predicted}"
        );
    }
}

#[test]
fn radii_are_the_roots_of_the_area_of_a_sample() {
    let view = room::view(0, 512);
    let all = lifted(&view, &view.distances, None);
    // Brute force: a disc of rho holds pi rho^2 / r^2 of the samples on its wall.
    let ratio = |index: usize| {
        let (here, normal, radius) = (
            place(&all, index),
            all.normals[index],
            f64::from(all.radii[index]),
        );
        let reach = 6.0 * radius;
        let near = (0..all.len()).filter(|&other| {
            place(&all, other).distance(here) < reach && all.normals[other].dot(normal) > 0.99
        });
        reach * (PI / near.count() as f64).sqrt() / radius
    };
    for rows in [0..20_u32, 60..100, 120..136, 200..256] {
        let row = |index: &usize| all.pixels[*index] / 512;
        let of_rows: Vec<usize> = (0..all.len())
            .filter(|index| rows.contains(&row(index)))
            .collect();
        let some = of_rows.iter().step_by(of_rows.len() / 60);
        let median = quantile(some.map(|&index| ratio(index)).collect(), 0.5);
        assert!((median - 1.0).abs() < 0.06, "rows {rows:?}: {median}");
    }
}

#[test]
fn as_many_are_kept_as_the_sphere_has_room_for() {
    let view = room::view(3, 512);
    let all = lifted(&view, &view.distances, None);
    let cosines = (0..256).map(|row| ((0.5 - (f64::from(row) + 0.5) / 256.0) * PI).cos());
    let (expected, variance) = cosines.fold((0.0, 0.0), |(sum, variance), cosine| {
        (
            sum + 512.0 * cosine,
            variance + 512.0 * cosine * (1.0 - cosine),
        )
    });
    let kept = (all.len() as u64 + all.counts.flying) as f64;
    assert!(
        (kept - expected).abs() < 3.0 * variance.sqrt(),
        "{kept} {expected}"
    );
    let counts = all.counts;
    let sum = all.len() as u64 + counts.unknown + counts.masked + counts.thinned + counts.flying;
    assert_eq!((sum, counts.pixels), (512 * 256, 512 * 256));
}

#[test]
fn every_pixel_is_kept_where_poles_are_not_thinned() {
    let view = room::view(3, 128);
    let given = DistanceView {
        view: &view.view,
        pixels: &view.pixels,
        mask: None,
        ignored: None,
        distances: &view.distances,
        confidences: None,
    };
    let settings = LiftSettings::OF_BEST_VIEWS;
    let thinned = lift(&given, 0, &settings);
    let all = lift(
        &given,
        0,
        &LiftSettings {
            thins_poles: false,
            ..settings
        },
    );
    assert_eq!(all.counts.thinned, 0);
    assert_eq!(all.len() as u64 + all.counts.flying, 128 * 64);
    // The kept samples of both are the same.
    let keep: Vec<bool> = all
        .pixels
        .iter()
        .map(|pixel| thinned.pixels.contains(pixel))
        .collect();
    let kept = all.retained(&keep);
    assert_eq!(kept.gaussians, thinned.gaussians);
    assert_eq!(kept.radii, thinned.radii);
}

#[test]
fn the_gaussians_lie_flat_on_the_surfaces() {
    let view = room::view(1, 256);
    let all = lifted(&view, &view.distances, None);
    for index in (0..all.len()).step_by(97) {
        let [w, x, y, z] = all.gaussians.rotations[index];
        let axis = Quat::from_xyzw(x, y, z, w) * Vec3::Z;
        assert!(axis.distance(all.normals[index]) < 1e-4);
        let [first, second, third] = all.gaussians.scales[index];
        assert!((first - 0.6 * all.radii[index]).abs() < 1e-6 && first == second);
        assert!((third - 0.06 * all.radii[index]).abs() < 1e-6);
        let pixel = all.pixels[index] as usize;
        let colour = all.gaussians.colours[index].map(|value| (value * 255.0).round() as u8);
        assert_eq!(colour, view.pixels[3 * pixel..3 * pixel + 3]);
    }
}

#[test]
fn what_hangs_between_surfaces_is_masked_or_unknown_is_left_out() {
    let view = room::view(1, 512);
    let mut smeared = view.distances.clone();
    // Edges between columns, smeared as by a network.
    for row in smeared.values.chunks_exact_mut(512) {
        let before = row.to_vec();
        let mut column = 1;
        while column < 511 {
            let (left, right) = (before[column - 1], before[column + 1]);
            if left.max(right) > 1.25 * left.min(right) {
                row[column] = 0.5 * (left + right);
                column += 1;
            }
            column += 1;
        }
    }
    let all = lifted(&view, &smeared, None);
    let changed = smeared.values.iter().zip(&view.distances.values);
    let wrong: Vec<bool> = changed.map(|(a, b)| (a / b - 1.0).abs() > 0.05).collect();
    let hanging = all
        .pixels
        .iter()
        .filter(|&&pixel| wrong[pixel as usize])
        .count();
    let all_hanging = wrong.iter().filter(|&&is_wrong| is_wrong).count();
    assert!(
        2 * hanging < all_hanging,
        "{hanging} of {all_hanging}, {:?}",
        all.counts
    );

    let mask: Vec<u8> = (0..512 * 256)
        .map(|at| if at % 512 < 100 { 255 } else { 0 })
        .collect();
    let mut holes = view.distances.clone();
    holes
        .values
        .iter_mut()
        .step_by(7)
        .for_each(|value| *value = 0.0);
    let all = lifted(&view, &holes, Some(&mask));
    assert!(all.counts.masked > 20_000 && all.counts.unknown > 15_000);
    assert!(
        all.pixels
            .iter()
            .all(|pixel| pixel % 512 >= 100 && pixel % 7 != 0)
    );
}

#[test]
fn distances_that_say_nothing_give_finite_samples_or_none() {
    let view = room::view(1, 64);
    let with = |value: &dyn Fn(usize) -> f32| DistanceImage {
        values: (0..64 * 32).map(value).collect(),
        ..view.distances.clone()
    };
    assert!(lifted(&view, &with(&|_| 0.0), None).is_empty());
    for distances in [
        with(&|_| 3.0),
        with(&|_| 1e-6),
        with(&|_| 1e6),
        with(&|at| if at % 64 == 31 { 2.0 } else { 0.0 }),
        with(&|at| if at % 2 == 0 { 1.0 } else { 1e4 }),
    ] {
        let all = lifted(&view, &distances, None);
        let scales = all.gaussians.scales.as_flattened();
        let rotations = all.gaussians.rotations.as_flattened();
        let positions = all.gaussians.positions.as_flattened();
        assert!(scales.iter().all(|scale| *scale > 0.0 && scale.is_finite()));
        assert!(
            rotations
                .iter()
                .chain(positions)
                .all(|value| value.is_finite())
        );
        for rotation in &all.gaussians.rotations {
            let length: f32 = rotation.iter().map(|q| q * q).sum();
            assert!((length - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn photographs_are_lifted_too() {
    let camera = PinholeCamera::with_horizontal_field_of_view(160, 120, 1.2);
    let metres = omnilife_schemas::Similarity::new([0.0; 3], 1.0);
    let view = room::view_of(1, camera.into(), &metres);
    let all = lifted(&view, &view.distances, None);
    assert_eq!(all.counts.thinned, 0);
    assert!(all.len() > 160 * 120 * 9 / 10, "{:?}", all.counts);
    let farthest = quantile(errors_metres(&all), 1.0);
    assert!(farthest < 1e-4, "{farthest}");
    let normals = quantile(normal_errors_degrees(&view, &all), 0.5);
    assert!(normals < 1.0, "{normals}");
}
