//! Poses with known errors, and displacements from other causes.

use glam::vec3;
use omnilife_schemas::camera::{ErpCamera, PinholeCamera};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::evidence::poses::*;

const CAMERA: Camera = Camera::Erp(ErpCamera::new(256, 128));

/// Returns observations of points all around cameras on a path, whose images are displaced by the twists, with
/// noise and some moving objects.
fn views(twists: &[Twist], noise: f32) -> Vec<(Vec3, Vec<Option<PoseObservation>>)> {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let mut vector = |size: f32| Vec3::from_array([0; 3].map(|_| random.random_range(-size..size)));
    let points: Vec<(Vec3, [Vec3; 3])> = (0..200)
        .map(|_| {
            (
                vector(1.0).normalize() * 5.0,
                [vector(1.0), vector(1.0), vector(1.0)],
            )
        })
        .collect();
    let middle = 0.5 * twists.len() as f32;
    let view = |(number, twist): (usize, &Twist)| {
        let centre = vec3(0.0, 0.02, 0.1) * (number as f32 - middle);
        let observation = |(point, (at, slopes)): (usize, &(Vec3, [Vec3; 3]))| {
            let mut observation = PoseObservation::new(*at - centre, *slopes, [0.0; 3]);
            let moves = if (point + number).is_multiple_of(15) {
                2.0
            } else {
                0.0
            };
            observation.residual = std::array::from_fn(|channel| {
                let chance = noise * ((point * 7 + number * 3 + channel) as f32).sin();
                dot(&observation.slopes[channel], twist) as f32
                    + chance
                    + moves
                    + 0.1 * channel as f32
            });
            (!(point + number).is_multiple_of(9)).then_some(observation)
        };
        (centre, points.iter().enumerate().map(observation).collect())
    };
    twists.iter().enumerate().map(view).collect()
}

/// Returns rotations of twenty views by so many radians, each about an axis of its own.
fn turns(size: f64) -> Vec<Twist> {
    let turn = |view: i32| {
        let along = f64::from(view * view);
        [along.sin(), 0.0, along.cos(), 0.0, 0.0, 0.0].map(|value| size * value)
    };
    (0..20).map(turn).collect()
}

#[test]
fn wrong_poses_are_told_from_noise_and_from_a_bent_scene() {
    let size = 0.01;
    let found = PoseEvidence::of(views(&turns(size), 0.01), &CAMERA, &CAMERA);
    assert_eq!(found.views, 20);
    // A rotation of 0.01 about an axis displaces points all around by `sqrt(2/3)` of it.
    let expected = (2.0_f64 / 3.0).sqrt() * size;
    assert!(
        (found.shift_radians / expected - 1.0).abs() < 0.15,
        "{found:?}"
    );
    assert!(
        (found.agreed_square.sqrt() / expected - 1.0).abs() < 0.15 && found.are_off(),
        "{found:?}"
    );
    assert!(
        found.to_string().contains("lie 0.3"),
        "{}",
        found.to_string()
    );
    assert!((4.5..5.5).contains(&found.distance), "{found:?}");

    let still = vec![[0.0; 6]; 20];
    // A path that is too long, and a scene that is rotated.
    let bent: Vec<Twist> = (0..20)
        .map(|view| [0.02, 0.0, 0.0, 0.0, 0.0, 0.005 * f64::from(view)])
        .collect();
    for twists in [still, bent] {
        let found = PoseEvidence::of(views(&twists, 0.01), &CAMERA, &CAMERA);
        assert!(
            !found.are_off() && found.agreed_pixels() < 0.02,
            "{found:?}"
        );
    }
}

/// Checks that errors of poses are angles, whatever the images' size.
#[test]
fn the_same_poses_are_refined_in_images_of_any_width() {
    let pinhole = PinholeCamera::with_horizontal_field_of_view(256, 144, 1.0);
    for camera in [CAMERA, Camera::Pinhole(pinhole)] {
        let resized =
            |factor: u32| camera.resized(factor * camera.width(), factor * camera.height());
        // The rotation of a view that displaces points by so many pixels at the least width.
        let radians = |pixels: f64| {
            let turn_pixels =
                PoseEvidence::of(views(&turns(0.01), 0.01), &camera, &camera).turn_pixels;
            pixels / turn_pixels * TAU / (2.0_f64 / 3.0).sqrt()
        };
        for (pixels, are_off) in [(0.08, false), (0.17, true)] {
            let seen = || views(&turns(radians(pixels)), 0.0001);
            for factor in [1, 2, 16] {
                let found = PoseEvidence::of(seen(), &resized(factor), &camera);
                assert_eq!(found.are_off(), are_off, "{factor}: {found}");
                let expected = f64::from(factor) * pixels;
                assert!(
                    (found.agreed_pixels() / expected - 1.0).abs() < 0.2,
                    "{found}"
                );
            }
        }
    }
}

/// Checks that images of 256 columns decide for wider ones by the pixels of these.
#[test]
fn wide_images_are_trained_with_poses_to_half_a_pixel() {
    let turn = |pixels: f64| pixels / 256.0 * TAU / (2.0_f64 / 3.0).sqrt();
    // Half a pixel of 4096 is 0.03 pixels of 256.
    for (pixels, width, are_off) in [
        (0.08, 256, false),
        (0.08, 1024, false),
        (0.08, 2048, true),
        (0.08, 4096, true),
        (0.045, 2048, false),
        (0.045, 4096, true),
        (0.02, 4096, false),
        (0.17, 1024, true),
    ] {
        let trained = CAMERA.resized(width, width / 2);
        let seen = views(&turns(turn(pixels)), 0.0001);
        let found = PoseEvidence::of(seen, &CAMERA, &trained);
        assert_eq!(found.are_off(), are_off, "{pixels} {width}: {found}");
    }
}

#[test]
fn neighbours_that_err_alike_are_no_wrong_pose() {
    let mut views = views(&[[0.0; 6]; 20], 0.01);
    // In every view a patch of the sphere, another one each time, is displaced by much: points all over it agree.
    for (number, (_, observations)) in views.iter_mut().enumerate() {
        let along = number as f32;
        let towards = vec3(along.sin(), along.cos(), 0.3).normalize().as_dvec3();
        let wrong = [0.03, -0.02, 0.04, 0.0, 0.0, 0.0];
        for seen in observations.iter_mut().flatten() {
            if seen.offset.normalize().dot(towards) > 0.9 {
                for (residual, slopes) in seen.residual.iter_mut().zip(&seen.slopes) {
                    *residual += dot(slopes, &wrong) as f32;
                }
            }
        }
    }
    let found = PoseEvidence::of(views, &CAMERA, &CAMERA);
    assert!(!found.are_off(), "{found:?}");
}

#[test]
fn too_little_to_see_says_nothing() {
    let mut few = views(&[[0.0; 6]; 12], 0.01);
    for (_, observations) in &mut few {
        observations.truncate(40);
    }
    // Too few views for a point's own error.
    let short = views(&[[0.0; 6]; 4], 0.01);
    for views in [few, short, Vec::new()] {
        assert_eq!(
            PoseEvidence::of(views, &CAMERA, &CAMERA),
            PoseEvidence::default()
        );
    }
}
