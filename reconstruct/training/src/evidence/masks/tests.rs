//! Moving objects, at several sizes and positions, against specks.

use glam::dvec2;
use omnilife_schemas::camera::{CameraModel, ErpCamera, PinholeCamera};

use super::*;

const HEIGHTS: [u32; 5] = [64, 128, 256, 512, 1024];

fn panorama(height: u32) -> Camera {
    let width = 2 * height;
    ErpCamera { width, height }.into()
}

/// Returns the share of each of `pixels` that lies within a range, pixels; the range may go on beyond the last
/// one.
fn shares(pixels: usize, [begin, end]: [f64; 2]) -> Vec<f64> {
    let share = |at: usize, offset: f64| {
        let first = at as f64 + offset;
        ((first + 1.0).min(end) - first.max(begin)).max(0.0)
    };
    (0..pixels)
        .map(|at| share(at, 0.0) + share(at, pixels as f64))
        .collect()
}

/// Returns marks of a panorama between two longitudes (from the left border) and two colatitudes, degrees.
fn marks(height: u32, longitudes: [f64; 2], colatitudes: [f64; 2]) -> Vec<u8> {
    let per_degree = f64::from(height) / 180.0;
    let columns = shares(2 * height as usize, longitudes.map(|at| at * per_degree));
    let rows = shares(height as usize, colatitudes.map(|at| at * per_degree));
    let of_row = |row: &f64| -> Vec<u8> {
        let row = *row;
        let shares = columns.iter().map(move |column| row * column);
        shares.map(|share| (255.0 * share).round() as u8).collect()
    };
    rows.iter().flat_map(of_row).collect()
}

/// Returns the evidence of masks among twenty views.
fn evidence(masks: &[Vec<u8>], camera: &Camera) -> MaskEvidence {
    let masks: Vec<&[u8]> = masks.iter().map(|mask| &mask[..]).collect();
    let is_marked = masks.iter().copied().flatten().any(|&mark| mark > 0);
    MaskEvidence {
        views: 20,
        masked_views: masks.len(),
        showing_views: showing_views(&masks, camera),
        coverage: Some(if is_marked { 0.001 } else { 0.0 }),
        coverage_error: standard_error(&covered_shares(&masks, camera)),
    }
}

/// Returns the masks of `views` views; the first `marked` are `mask`, the others empty.
fn first_marked(marked: usize, views: usize, mask: &[u8]) -> Vec<Vec<u8>> {
    let mut masks = vec![vec![0; mask.len()]; views];
    masks[..marked].fill(mask.to_vec());
    masks
}

#[test]
fn a_person_far_away_is_shown_at_any_size_and_place() {
    for height in HEIGHTS {
        let camera = panorama(height);
        // In the middle, beside pixels' borders, and across the seam.
        for left in [180.0, 100.7, 359.1] {
            let person = marks(height, [left, left + 2.0], [88.3, 93.3]);
            let empty = vec![0; person.len()];
            let once = [person.clone(), empty.clone(), empty.clone()];
            let found = evidence(&once, &camera);
            assert!(
                found.showing_views == 1 && !found.show_something(),
                "{found}"
            );
            let found = evidence(&[person.clone(), empty, person], &camera);
            assert!(found.show_something(), "{height} {left}: {found}");
            assert!(found.warnings().is_empty());
        }
    }
}

#[test]
fn specks_show_nothing_however_many() {
    let one = |height: u32, step: usize| -> Vec<u8> {
        let pixels = 2 * (height * height) as usize;
        let mut mask = vec![0; pixels];
        let middle = pixels / 2 + height as usize;
        for pixel in (middle..pixels).step_by(step) {
            mask[pixel] = 255;
        }
        mask
    };
    for height in HEIGHTS {
        let camera = panorama(height);
        let alone = one(height, usize::MAX);
        // A pixel of the smallest panorama is as large as a person.
        let views = if height > 128 { 3 } else { 39 };
        for marked in [1, 2, views] {
            let found = evidence(&first_marked(marked, views, &alone), &camera);
            assert!(found.are_noise(), "{height} {marked}: {found}");
            assert_eq!(found.warnings().len(), 1);
        }
        let many = one(height, 7);
        let found = evidence(&[many.clone(), many.clone(), many], &camera);
        assert!(
            found.showing_views == 0 && found.are_noise(),
            "{height}: {found}"
        );
    }
}

/// Checks a patch of a thousandth of the sphere, which most of the views show.
#[test]
fn a_small_object_in_most_views_is_shown_with_its_standard_error() {
    for height in [64, 128, 256] {
        let camera = panorama(height);
        // 6.4 by 6.4 degrees at the equator are a thousandth of 4 pi steradians.
        let object = marks(height, [100.3, 106.74], [86.8, 93.2]);
        let found = evidence(&first_marked(30, 39, &object), &camera);
        assert!(found.show_something() && !found.are_noise(), "{found}");
        assert_eq!(found.showing_views, 30);
        // 30 of 39 masks of a thousandth: the error of the mean is 0.001 sqrt(30 9 / 39^2 / 38).
        let expected = 1e-3 * (270.0_f64 / 1521.0 / 38.0).sqrt();
        let error = found.coverage_error.unwrap_or_default();
        assert!((error / expected - 1.0).abs() < 0.02, "{error} {expected}");
    }
    let one = evidence(&[vec![255; 128 * 64]], &panorama(64));
    assert_eq!(one.coverage_error, None);
}

#[test]
fn masks_that_are_empty_are_no_noise() {
    let found = evidence(&[vec![0; 128 * 64], vec![0; 128 * 64]], &panorama(64));
    assert!(!found.show_something() && found.warnings().is_empty());
}

#[test]
fn patches_at_a_pole_are_one() {
    for height in [256, 512, 1024] {
        let camera = panorama(height);
        for colatitudes in [[0.0, 1.7], [178.3, 180.0]] {
            let sector = marks(height, [10.0, 100.0], colatitudes);
            let found = evidence(&[sector.clone(), sector.clone()], &camera);
            assert!(!found.show_something(), "{height}: {found}");
            let other = marks(height, [190.0, 280.0], colatitudes);
            let both: Vec<u8> = sector.iter().zip(&other).map(|(a, b)| a | b).collect();
            let found = evidence(&[both.clone(), both], &camera);
            assert!(found.show_something(), "{height}: {found}");
        }
    }
}

#[test]
fn pinholes_see_less_and_smaller_things() {
    for [width, height] in [[160, 90], [640, 360], [1600, 900]] {
        let camera: Camera =
            PinholeCamera::with_horizontal_field_of_view(width, height, 60.0_f64.to_radians())
                .into();
        let columns = width as usize;
        let within = |half: [f64; 2]| -> Vec<u8> {
            let is_marked = |pixel: usize| {
                let at = dvec2(
                    (pixel % columns) as f64 + 0.5,
                    (pixel / columns) as f64 + 0.5,
                );
                let direction = camera.unproject(at);
                (direction.x / direction.z).abs() < half[0].to_radians().tan()
                    && (direction.y / direction.z).abs() < half[1].to_radians().tan()
            };
            let pixels = columns * height as usize;
            (0..pixels)
                .map(|pixel| if is_marked(pixel) { 255 } else { 0 })
                .collect()
        };
        // A car of 4 m by 2 m from 100 m above it; a pixel at the left border and one at the right are specks.
        let car = within([1.15, 0.57]);
        let found = evidence(&[car.clone(), car], &camera);
        assert!(found.show_something(), "{width}: {found}");
        let mut speck = vec![0; columns * height as usize];
        speck[5 * columns] = 255;
        speck[9 * columns - 1] = 255;
        let found = evidence(&[speck.clone(), speck], &camera);
        assert!(!found.show_something(), "{width}: {found}");
    }
}
