//! Agreement of views with distances: scales, redundancy, the fused surface, conventions and mirrored worlds.
//! Expected values come from a room in closed form, and from loops in f64.

use crate::depth::room::{self, RoomView};
use glam::{DVec3, Vec3};
use omnilife_engine::losses::scaffold::{Scaffold, fuse::FusedView};
use omnilife_reconstruct::seeds::depth::{
    DistanceView, LiftSettings, SurfaceSamples, agreement, checks, fit_scales, incidence, lift,
    tolerance,
    units::{Reading, other_unit},
};
use omnilife_schemas::{
    camera::{CameraModel, ErpCamera},
    records::DistanceConvention,
};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

fn views(count: usize, width: usize) -> Vec<RoomView> {
    (0..count).map(|number| room::view(number, width)).collect()
}

fn distance_views(views: &[RoomView]) -> Vec<DistanceView<'_>> {
    views.iter().map(given).collect()
}

fn given(view: &RoomView) -> DistanceView<'_> {
    DistanceView {
        view: &view.view,
        pixels: &view.pixels,
        mask: None,
        ignored: None,
        distances: &view.distances,
        confidences: None,
    }
}

fn scale(view: &mut RoomView, factor: f64) {
    let values = view.distances.values.iter_mut();
    values.for_each(|value| *value = (f64::from(*value) * factor) as f32);
}

#[test]
fn scales_are_found_to_a_fraction_of_their_errors() {
    let mut views = views(8, 256);
    let exact = fit_scales(&distance_views(&views));
    assert!(exact.disagreement_before.unwrap() < 0.005, "{exact:?}");
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let errors: Vec<f64> = (0..8)
        .map(|_| {
            let normal: f64 = StandardNormal.sample(&mut random);
            0.02 * normal
        })
        .collect();
    for (view, error) in views.iter_mut().zip(&errors) {
        scale(view, error.exp());
    }
    let fit = fit_scales(&distance_views(&views));
    let mean = errors.iter().sum::<f64>() / 8.0;
    let left: Vec<f64> = errors
        .iter()
        .zip(&fit.log_scales)
        .map(|(error, found)| error - mean + found)
        .collect();
    let deviation = (left.iter().map(|left| left * left).sum::<f64>() / 8.0).sqrt();
    assert!(deviation < 0.002, "{deviation} {left:?}");
    let [before, after] = [fit.disagreement_before, fit.disagreement_after].map(Option::unwrap);
    assert!(before > 0.01 && after < 0.005);
    assert_eq!(fit.groups.len(), 1);
}

#[test]
fn views_without_a_common_surface_are_groups_of_their_own() {
    let mut views = views(4, 128);
    // Two views of a world ten times as large, elsewhere.
    for view in &mut views[2..] {
        scale(view, 10.0);
        view.view.centre += Vec3::splat(500.0);
    }
    let fit = fit_scales(&distance_views(&views));
    assert_eq!(fit.groups[0], [0, 1]);
    assert!(fit.groups.len() > 1);
    assert!(fit.log_scales.iter().all(|scale| scale.is_finite()));
    let alone = fit_scales(&distance_views(&views[..1]));
    assert_eq!((alone.log_scales, alone.groups), (vec![0.0], vec![vec![0]]));
}

/// Returns support, number of views that see past it and the finest flag, one sample and f64 throughout.
fn by_brute_force(
    lifted: &SurfaceSamples,
    index: usize,
    own: usize,
    views: &[RoomView],
    tolerance: f64,
) -> Option<(u16, u16, bool)> {
    let place = Vec3::from_array(lifted.gaussians.positions[index]).as_dvec3();
    let normal = lifted.normals[index].as_dvec3();
    let pitch = std::f64::consts::PI / views[0].distances.height as f64;
    let (mut support, mut free, mut is_finest) = (0, 0, true);
    for (_, other) in views
        .iter()
        .enumerate()
        .filter(|(number, _)| *number != own)
    {
        let camera = ErpCamera::new(other.distances.width as u32, other.distances.height as u32);
        let away = place - other.centre;
        let distance = away.length();
        let pixel = camera.project(other.to_world.transpose() * away).unwrap();
        // On the border between pixels f32 may select the other one.
        let [u, v] = [pixel.x.fract(), pixel.y.fract()];
        if [u, v].iter().any(|at| !(1e-3..0.999).contains(at)) {
            return None;
        }
        let at = pixel.y as usize * other.distances.width + pixel.x as usize;
        let theirs = f64::from(other.distances.values[at]);
        let ratio = theirs / distance;
        if (ratio - 1.0 - 2.5 * tolerance).abs() < 1e-5
            || ((ratio - 1.0).abs() - tolerance).abs() < 1e-5
        {
            return None;
        }
        free += u16::from(ratio > 1.0 + 2.5 * tolerance);
        if (ratio - 1.0).abs() >= tolerance {
            continue;
        }
        support += 1;
        let cosine = normal.dot(away / distance).abs().max(0.05);
        let radius = distance * pitch / cosine.sqrt();
        let own_radius = f64::from(lifted.radii[index]);
        if (radius / own_radius - 1.0).abs() < 1e-5 {
            return None;
        }
        is_finest &= radius > own_radius;
    }
    Some((support, free, is_finest))
}

#[test]
fn the_finest_view_of_a_place_is_that_of_brute_force() {
    let views = views(5, 256);
    let given = distance_views(&views);
    let (mut all, mut kept) = (0, 0);
    for own in 0..5 {
        let lifted = lift(&given[own], own as u64, &LiftSettings::OF_BEST_VIEWS);
        let found = agreement(&lifted, own, &given, 0.02);
        let mut compared = 0;
        for index in (0..lifted.len()).step_by(13) {
            let Some(expected) = by_brute_force(&lifted, index, own, &views, 0.02) else {
                continue;
            };
            compared += 1;
            let found = found[index];
            assert_eq!((found.support, found.free, found.is_finest), expected);
        }
        assert!(compared > 500, "{compared} of {}", lifted.len() / 13);
        all += lifted.len();
        kept += found.iter().filter(|found| found.is_finest).count();
    }
    let share = f64::from(kept as u32) / f64::from(all as u32);
    // Five views of one room: between a fifth and all of it.
    assert!((0.2..0.7).contains(&share), "{share}");
    assert!(
        (tolerance(Some(0.001)) - 0.02).abs() < 1e-12
            && (tolerance(Some(0.05)) - 0.15).abs() < 1e-12
    );
}

fn fused(views: &[RoomView], order: &[usize], voxel: f32) -> Scaffold {
    let given = distance_views(views);
    let incidences: Vec<Vec<f32>> = given.iter().map(incidence).collect();
    let views: Vec<FusedView<'_>> = order
        .iter()
        .map(|&number| FusedView {
            view: &views[number].view,
            distances: &views[number].distances,
            incidence: &incidences[number],
        })
        .collect();
    Scaffold::fuse(&views, voxel, Vec3::ZERO)
}

/// Returns positions along the rays of some pixels, in front of and behind the surfaces.
fn places(views: &[RoomView], reach: f64) -> Vec<DVec3> {
    let mut random = Pcg64Mcg::seed_from_u64(9);
    let mut found = Vec::new();
    for view in views {
        let given = distance_views(std::slice::from_ref(view));
        let lifted = lift(&given[0], 0, &LiftSettings::OF_BEST_VIEWS);
        for index in (0..lifted.len()).step_by(41) {
            let place = Vec3::from_array(lifted.gaussians.positions[index]).as_dvec3();
            let normal: f64 = StandardNormal.sample(&mut random);
            let along = (0.5 * normal).clamp(-0.9, 0.9) * reach;
            found.push(place + lifted.normals[index].as_dvec3() * along);
        }
    }
    found
}

#[test]
fn the_fused_field_is_the_signed_distance_of_the_room_near_its_surfaces() {
    let views = views(6, 512);
    let voxel = 0.05_f32;
    let field = fused(&views, &[0, 1, 2, 3, 4, 5], voxel);
    let mut errors = Vec::new();
    let places = places(&views, 1.5 * f64::from(voxel));
    for &place in &places {
        if let Some(value) = field.value(place.as_vec3()) {
            let error = f64::from(value.distance) - room::signed_distance(place);
            errors.push(error.abs() / f64::from(voxel));
        }
    }
    assert!(
        errors.len() > places.len() / 2,
        "{} of {}",
        errors.len(),
        places.len()
    );
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[(share * (errors.len() - 1) as f64) as usize];
    assert!(at(0.5) <= 0.1, "median {} voxels", at(0.5));
    assert!(at(0.99) <= 0.5, "99th percentile {} voxels", at(0.99));
}

#[test]
fn the_order_of_the_views_changes_no_bit_and_the_loss_has_the_gradient_that_differences_have() {
    let views = views(3, 256);
    let voxel = 0.08;
    let (forward, backward) = (
        fused(&views, &[0, 1, 2], voxel),
        fused(&views, &[2, 0, 1], voxel),
    );
    assert_eq!(forward.bytes(), backward.bytes());
    let places = places(&views[..1], 0.1);
    let centres: Vec<[f32; 3]> = places
        .iter()
        .map(|place| place.as_vec3().to_array())
        .collect();
    for &centre in &centres {
        let place = Vec3::from_array(centre);
        assert_eq!(forward.value(place), backward.value(place));
    }
    assert_eq!(forward.value(Vec3::splat(1e30)), None);
    assert_eq!(forward.value(Vec3::splat(f32::NAN)), None);
    let mut gradient = vec![[0.0; 3]; centres.len()];
    let mean = |_: usize| 0.1 / centres.len() as f32;
    let loss = forward.loss(&centres, mean, &mut gradient);
    assert!(loss > 0.0 && loss.is_finite());
    // Steps down the gradient reduce it.
    let longest = gradient
        .as_flattened()
        .iter()
        .fold(0.0_f32, |a, b| a.max(b.abs()));
    let moved: Vec<[f32; 3]> = centres
        .iter()
        .zip(&gradient)
        .map(|(centre, by)| [0, 1, 2].map(|axis| centre[axis] - 0.004 * by[axis] / longest))
        .collect();
    let after = forward.loss(&moved, mean, &mut vec![[0.0; 3]; moved.len()]);
    assert!(after < loss, "{after} {loss}");
    // Each centre has its own weight, and without one neither loss nor gradient.
    let by_number = |number: usize| [0.0, 0.3, 0.5][number % 3] / centres.len() as f32;
    let mut weighted = vec![[0.0; 3]; centres.len()];
    let value = forward.loss(&centres, by_number, &mut weighted);
    let mut expected = 0.0;
    for (number, centre) in centres.iter().enumerate() {
        let share = by_number(number) / mean(number);
        let mut alone = [[0.0; 3]];
        let own = forward.loss(std::slice::from_ref(centre), |_| 1.0, &mut alone);
        expected += own * f64::from(by_number(number));
        for axis in 0..3 {
            let (found, whole) = (weighted[number][axis], share * gradient[number][axis]);
            assert!(
                (found - whole).abs() <= 1e-6 * whole.abs(),
                "{found} {whole}"
            );
        }
    }
    assert!(
        (value - expected).abs() < 1e-9 * (1.0 + expected),
        "{value} {expected}"
    );
}

#[test]
fn a_unit_other_than_that_of_the_poses_and_disparities_are_named() {
    let found = |change: &dyn Fn(&mut RoomView)| {
        let mut views = views(5, 256);
        views.iter_mut().for_each(change);
        other_unit(&distance_views(&views))
    };
    assert_eq!(found(&|_| ()), None);
    for factor in [0.001, 0.42, 3.0, 100.0] {
        let other = found(&|view| scale(view, factor));
        let other = other.unwrap_or_else(|| panic!("{factor}"));
        let Reading::Times(back) = other.reading else {
            panic!("{other:?}")
        };
        assert!((back * factor - 1.0).abs() < 0.03, "{other:?}");
        assert!(3.0 * other.otherwise < other.as_given, "{other:?}");
    }
    for numerator in [1.0, 20.0] {
        let invert = |view: &mut RoomView| {
            let values = view.distances.values.iter_mut();
            values.for_each(|value| *value = numerator / *value);
        };
        let other = found(&invert).unwrap();
        let Reading::Over(over) = other.reading else {
            panic!("{other:?}")
        };
        assert!(
            (over / f64::from(numerator) - 1.0).abs() < 0.03,
            "{other:?}"
        );
    }
    // Errors of single views, and numbers that are no distances, have no common factor.
    let mut errors = views(5, 256);
    for (view, factor) in errors.iter_mut().zip([0.5, 1.4, 0.8, 2.5, 1.0]) {
        scale(view, factor);
    }
    assert_eq!(other_unit(&distance_views(&errors)), None);
    let noise = |view: &mut RoomView| {
        let mut random = Pcg64Mcg::seed_from_u64(view.pixels[0].into());
        for value in &mut view.distances.values {
            let normal: f64 = StandardNormal.sample(&mut random);
            *value = normal.exp() as f32;
        }
    };
    assert_eq!(found(&noise), None);
}

#[test]
fn a_mirrored_world_and_a_wrong_convention_show() {
    let views = views(5, 256);
    let given = distance_views(&views);
    let [straight, mirrored] = checks::handedness_scores(&given).unwrap();
    assert!(straight > mirrored + 3.0, "{straight} {mirrored}");
    let [straight, mirrored] = checks::mirrored_disagreements(&given).unwrap();
    assert!(1.5 * straight < mirrored, "{straight} {mirrored}");
    let flipped = |with_images: bool| -> Vec<RoomView> {
        let mut views = self::views(5, 256);
        for view in &mut views {
            let rows = view.distances.values.chunks_exact_mut(256);
            rows.for_each(<[f32]>::reverse);
            let pixels = view.pixels.as_chunks_mut::<3>().0;
            if with_images {
                pixels.chunks_exact_mut(256).for_each(<[[u8; 3]]>::reverse);
            }
        }
        views
    };
    let all = flipped(true);
    let [straight, mirrored] = checks::handedness_scores(&distance_views(&all)).unwrap();
    assert!(mirrored > straight + 3.0, "{straight} {mirrored}");
    // Distances alone: colours give no evidence of it.
    let distances = flipped(false);
    let distances = distance_views(&distances);
    if let Some([straight, mirrored]) = checks::handedness_scores(&distances) {
        assert!(mirrored < straight + 3.0, "{straight} {mirrored}");
    }
    let [straight, mirrored] = checks::mirrored_disagreements(&distances).unwrap();
    assert!(straight > 1.5 * mirrored, "{straight} {mirrored}");

    let [ray, z] = checks::convention_disagreements(&given, DistanceConvention::Z).unwrap();
    assert!(3.0 * ray < z, "{ray} {z}");
    let mut wrong = self::views(5, 256);
    for view in &mut wrong {
        let camera = ErpCamera::new(256, 128);
        view.distances = view
            .distances
            .clone()
            .along_rays(DistanceConvention::Z, &camera);
    }
    let given = distance_views(&wrong);
    let [as_given, otherwise] =
        checks::convention_disagreements(&given, DistanceConvention::Ray).unwrap();
    assert!(as_given > 3.0 * otherwise, "{as_given} {otherwise}");
}
