//! Hits, angles, layers and textures compared with golden values and central differences.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::{
    compose::{Layer, compose, compose_vjp, sort},
    plane::{Ray, hit, hit_vjp},
    sphere::{self, Sphere},
    texture::{Texture, TextureEdge, direction_gradient},
    view_angle::{view_angle, view_angle_vjp},
};
use crate::{
    golden_tests::{golden, numbers, vector},
    trajectories::rigid_spline::RigidPose,
};

fn tilted() -> RigidPose {
    RigidPose {
        centre: DVec3::new(0.1, -0.2, 2.0),
        rotation: DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.2, -0.3, 0.1))),
    }
}

const SIZE: DVec2 = DVec2::new(1.5, 1.0);

fn ray() -> Ray {
    Ray {
        origin: DVec3::ZERO,
        direction: DVec3::new(0.1, -0.05, 1.0).normalize(),
    }
}

#[test]
fn hits_and_angles_are_golden() {
    let found = hit(&ray(), &tilted(), SIZE).expect("a hit");
    let expected = &golden()["plane_hit"];
    assert!((found.distance - expected["distance"].as_f64().expect("number")).abs() < 1e-12);
    assert!((found.uv - DVec2::from_slice(&numbers(&expected["uv"]))).length() < 1e-12);
    let inside = Ray {
        origin: DVec3::new(0.1, 0.0, 0.2),
        direction: DVec3::Z,
    };
    let sphere = Sphere {
        centre: DVec3::ZERO,
        radius: 3.0,
    };
    let distance = sphere::hit(&inside, &sphere).expect("a hit").distance;
    assert!((distance - golden()["sphere_distance"].as_f64().expect("number")).abs() < 1e-12);
    let found = view_angle(DVec3::new(0.3, -0.2, 0.8).normalize());
    assert!((found - DVec2::from_slice(&numbers(&golden()["view_angle"]))).length() < 1e-12);
}

#[test]
fn gradients_of_a_hit_are_central_differences() {
    let (by_uv, by_direction) = (DVec2::new(0.7, -0.4), DVec3::new(0.3, 0.9, -0.5));
    let value = |ray: &Ray, pose: &RigidPose| {
        let found = hit(ray, pose, SIZE).expect("a hit");
        by_uv.dot(found.uv) + by_direction.dot(found.direction)
    };
    let found = hit(&ray(), &tilted(), SIZE).expect("a hit");
    let gradient = hit_vjp(&ray(), &tilted(), SIZE, &found, by_uv, by_direction);
    let (of_pose, of_ray) = (gradient.pose(), gradient.ray);
    let check = |found: f64, at: &dyn Fn(f64) -> f64| {
        let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((found - expected).abs() < 1e-8, "{found} {expected}");
    };
    for axis in 0..3 {
        check(of_ray.origin[axis], &|step| {
            let mut ray = ray();
            ray.origin[axis] += step;
            value(&ray, &tilted())
        });
        check(of_ray.direction[axis], &|step| {
            let mut ray = ray();
            ray.direction[axis] += step;
            value(&ray, &tilted())
        });
        check(of_pose.centre[axis], &|step| {
            let mut pose = tilted();
            pose.centre[axis] += step;
            value(&ray(), &pose)
        });
        for column in 0..3 {
            check(of_pose.rotation.col(column)[axis], &|step| {
                let mut pose = tilted();
                pose.rotation.col_mut(column)[axis] += step;
                value(&ray(), &pose)
            });
        }
    }
}

#[test]
fn planes_that_cannot_be_seen_are_missed() {
    let facing = |centre: DVec3, turn: f64| RigidPose {
        centre,
        rotation: DMat3::from_rotation_y(turn),
    };
    let forward = Ray {
        origin: DVec3::ZERO,
        direction: DVec3::Z,
    };
    let seen = |pose: &RigidPose| hit(&forward, pose, DVec2::ONE).is_some();
    assert!(seen(&facing(2.0 * DVec3::Z, 0.0)) && seen(&facing(2.0 * DVec3::Z, 3.1)));
    // Parallel, behind, and through the camera.
    let quarter = std::f64::consts::FRAC_PI_2;
    assert!(
        !seen(&facing(2.0 * DVec3::Z, quarter)) && !seen(&facing(2.0 * DVec3::Z, quarter + 1e-7))
    );
    assert!(!seen(&facing(-2.0 * DVec3::Z, 0.0)) && !seen(&facing(DVec3::ZERO, 0.0)));
    assert!(!seen(&facing(f64::NAN * DVec3::Z, 0.0)));
    // On the edge, and just beyond it.
    assert!(seen(&facing(DVec3::new(0.5, -0.5, 2.0), 0.0)));
    assert!(!seen(&facing(DVec3::new(0.5 + 1e-15, 0.0, 2.0), 0.0)));
    // Tilted by 80 degrees: within the box of its corners, but beyond its edge.
    let tilted = facing(DVec3::new(0.3, 0.0, 2.0), 80_f64.to_radians());
    assert!(!seen(&tilted));
}

#[test]
fn gradients_on_the_sphere_are_central_differences() {
    let sphere = Sphere {
        centre: DVec3::new(0.1, 0.2, -0.1),
        radius: 3.0,
    };
    let upstream = DVec3::new(0.7, -0.4, 0.5);
    for direction in [DVec3::new(0.3, -0.2, 0.9), DVec3::new(-0.5, 0.4, -0.7)] {
        let ray = Ray {
            origin: DVec3::new(1.5, -0.8, 1.2),
            direction: direction.normalize(),
        };
        let found = sphere::hit(&ray, &sphere).expect("a hit");
        let gradient = sphere::hit_vjp(&ray, &sphere, &found, upstream);
        // Directions keep their length, so that the derivative along the ray is excluded.
        let across = |v: DVec3| v - v.dot(ray.direction) * ray.direction;
        for axis in 0..3 {
            let at = |step: f64, is_origin: bool| {
                let mut moved = ray;
                let shift = step * DVec3::AXES[axis];
                if is_origin {
                    moved.origin += shift;
                } else {
                    moved.direction = (ray.direction + across(shift)).normalize();
                }
                upstream.dot(sphere::hit(&moved, &sphere).expect("a hit").normal)
            };
            let expected = (at(1e-6, true) - at(-1e-6, true)) / 2e-6;
            assert!((gradient.origin[axis] - expected).abs() < 1e-8);
            let expected = (at(1e-6, false) - at(-1e-6, false)) / 2e-6;
            let found = gradient.direction.dot(across(DVec3::AXES[axis]));
            assert!((found - expected).abs() < 1e-8, "{found} {expected}");
        }
    }
    // Nearly on the sphere, and looking outwards, where the stable form is needed.
    let ray = Ray {
        origin: sphere.centre + (3.0 - 1e-9) * DVec3::X,
        direction: DVec3::X,
    };
    let found = sphere::hit(&ray, &sphere).expect("a hit").distance;
    assert!((found / 1e-9 - 1.0).abs() < 1e-5, "{found}");
}

#[test]
fn angles_have_their_limits_and_gradients() {
    assert_eq!(view_angle(DVec3::Z), DVec2::ZERO);
    assert_eq!(view_angle(-DVec3::Z), DVec2::ZERO);
    let sideways = view_angle(DVec3::X);
    assert!((sideways - DVec2::new(0.0, std::f64::consts::FRAC_PI_2)).length() < 1e-12);
    let upstream = DVec2::new(0.6, -0.8);
    for direction in [
        DVec3::new(0.3, -0.2, 0.8),
        DVec3::new(0.3, 0.4, -0.5),
        DVec3::new(1e-3, 2e-3, 1.0),
        DVec3::new(0.9, 0.1, 0.0),
    ] {
        let found = view_angle_vjp(direction, upstream);
        for axis in 0..3 {
            let at = |step: f64| upstream.dot(view_angle(direction + step * DVec3::AXES[axis]));
            let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((found[axis] - expected).abs() < 1e-6, "{direction} {axis}");
        }
    }
    assert_eq!(
        view_angle_vjp(DVec3::Z, upstream),
        DVec3::new(-0.8, -0.6, 0.0)
    );
}

fn layer(distance: f64, surface: usize, opacity: f64) -> Layer {
    let wave = |phase: f64| 0.5 + 0.4 * (1.3 * surface as f64 + phase).sin();
    Layer {
        distance,
        surface,
        colour: DVec3::new(wave(0.0), wave(1.0), wave(2.0)),
        opacity,
    }
}

#[test]
fn composed_layers_are_golden() {
    let layers =
        [(DVec3::X, 0.25), (DVec3::Y, 0.5), (DVec3::Z, 1.0)].map(|(colour, opacity)| Layer {
            distance: 1.0,
            surface: 0,
            colour,
            opacity,
        });
    let found = compose(&layers);
    assert!((found - vector(&golden()["composed"])).length() < 1e-15);
}

#[test]
fn gradients_of_layers_are_central_differences_behind_opaque_ones_too() {
    let upstream = DVec3::new(0.3, -0.5, 0.8);
    let opacities: [Vec<f64>; 4] = [
        vec![0.4],
        vec![0.4, 1.0, 0.7, 0.2],
        vec![0.0, 0.3, 1.0 - 1e-7, 1.0, 0.5],
        vec![1.0; 64],
    ];
    for opacities in opacities {
        let opacities = opacities.iter().enumerate();
        let layers: Vec<Layer> = opacities.map(|(at, &a)| layer(1.0, at, a)).collect();
        let mut gradients = Vec::new();
        compose_vjp(&layers, upstream, &mut gradients);
        for (at, gradient) in gradients.iter().enumerate() {
            let moved = |step: f64| {
                let mut layers = layers.clone();
                layers[at].opacity += step;
                upstream.dot(compose(&layers))
            };
            let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((gradient.opacity - expected).abs() < 1e-8);
            for axis in 0..3 {
                let moved = |step: f64| {
                    let mut layers = layers.clone();
                    layers[at].colour[axis] += step;
                    upstream.dot(compose(&layers))
                };
                let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!((gradient.colour[axis] - expected).abs() < 1e-8);
            }
        }
    }
}

#[test]
fn equal_distances_follow_the_number_of_the_surface() {
    let mut layers = [layer(2.0, 1, 0.5), layer(1.0, 3, 0.5), layer(1.0, 2, 0.5)];
    sort(&mut layers);
    assert_eq!(layers.map(|layer| layer.surface), [2, 3, 1]);
}

#[test]
fn textures_read_their_texels_and_have_central_differences() {
    let texels = |count: usize| -> Vec<[f32; 2]> {
        (0..count)
            .map(|at| [(1.3 * at as f32).sin(), (0.7 * at as f32).cos()])
            .collect()
    };
    let texture = Texture {
        width: 6,
        height: 5,
        texels: texels(30),
    };
    for (row, column) in [(0, 0), (4, 5), (2, 3)] {
        let uv = DVec2::new(column as f64 / 5.0, row as f64 / 4.0);
        let found = texture
            .sample(uv, TextureEdge::Zero)
            .value
            .map(|v| v as f32);
        let expected = texture.texels[row * 6 + column];
        assert!((found[0] - expected[0]).abs() < 1e-6 && (found[1] - expected[1]).abs() < 1e-6);
    }
    assert_eq!(
        texture.sample(DVec2::splat(2.0), TextureEdge::Zero).value,
        [0.0; 2]
    );
    for beyond in [TextureEdge::Zero, TextureEdge::Border] {
        for uv in [
            DVec2::new(0.37, 0.61),
            DVec2::new(-0.05, 0.4),
            DVec2::new(1.02, 1.1),
        ] {
            let found = texture.sample(uv, beyond);
            let at = |shift: DVec2| texture.sample(uv + shift, beyond).value[1];
            let by_u = (at(DVec2::X * 1e-6) - at(-DVec2::X * 1e-6)) / 2e-6;
            let by_v = (at(DVec2::Y * 1e-6) - at(-DVec2::Y * 1e-6)) / 2e-6;
            assert!((found.by_u[1] - by_u).abs() < 1e-6 && (found.by_v[1] - by_v).abs() < 1e-6);
        }
    }
    // On the sphere, values are continuous across the seam and over a pole.
    let sphere = Texture {
        width: 8,
        height: 4,
        texels: texels(32),
    };
    let read = |direction: DVec3| sphere.sample_direction(direction.normalize()).value[0];
    for (a, b) in [
        (DVec3::new(1e-9, 0.2, -1.0), DVec3::new(-1e-9, 0.2, -1.0)),
        (DVec3::new(1e-9, -1.0, 1e-9), DVec3::new(-1e-9, -1.0, -1e-9)),
    ] {
        assert!((read(a) - read(b)).abs() < 1e-6, "{a} {b}");
    }
    let direction = DVec3::new(0.4, -0.3, 0.7).normalize();
    let found = sphere.sample_direction(direction);
    let gradient = direction_gradient(direction, found.by_u[0], found.by_v[0]);
    for axis in DVec3::AXES {
        let across = axis - axis.dot(direction) * direction;
        let expected = (read(direction + 1e-6 * across) - read(direction - 1e-6 * across)) / 2e-6;
        assert!((gradient.dot(across) - expected).abs() < 1e-6);
    }
}
