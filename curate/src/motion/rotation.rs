//! The rotation between two images of the sphere, from their pixels.

use std::f32::consts::TAU;

use glam::{Mat3, Quat, Vec3};

use super::grey::{GreySphere, even_directions, tangents};

/// Directions at which the images are compared.
const SAMPLES: usize = 3000;
/// Steps per level of the pyramid.
const STEPS: usize = 12;
/// Differences of grey value above this count less (Huber), of [0, 1].
const HUBER: f32 = 0.05;
/// Levels of the pyramid that are used, from the smallest: motion in the scene dominates the
/// finer ones.
const LEVELS: usize = 3;
/// Share of a small turn's differences that those of a larger one must stay below.
const CLEARLY_BETTER: f32 = 0.7;

/// Finds the rotation that takes directions in `from` to directions in `to`, by Gauss-Newton on the difference of grey
/// values, from coarse to fine. It starts at the best of all yaws, so that rotations about the vertical of any size are
/// found; other ones up to about a radian.
pub fn align(from: &GreySphere, to: &GreySphere) -> Quat {
    let directions: Vec<Vec3> = even_directions(SAMPLES).collect();
    let coarsest = from.levels() - 1;
    let yaws = from.width(coarsest);
    let mut best = (f32::INFINITY, Quat::IDENTITY);
    for step in 0..yaws {
        let rotation = Quat::from_rotation_y(step as f32 / yaws as f32 * TAU);
        let cost = cost(from, to, coarsest, &directions, rotation);
        if cost < best.0 {
            best = (cost, rotation);
        }
    }
    refined(from, to, &directions, best.1)
}

/// Finds the rotation between neighbouring frames of a video: as [`align`], but a jump to another yaw has to fit
/// clearly better than a small turn. Facades and skies repeat themselves, and cameras rarely jump.
pub(super) fn align_neighbours(from: &GreySphere, to: &GreySphere) -> Quat {
    let directions: Vec<Vec3> = even_directions(SAMPLES).collect();
    let small = refined(from, to, &directions, Quat::IDENTITY);
    let any = align(from, to);
    let level = from.levels().saturating_sub(LEVELS);
    let [small_cost, any_cost] =
        [small, any].map(|rotation| cost(from, to, level, &directions, rotation));
    if any_cost < CLEARLY_BETTER * small_cost {
        any
    } else {
        small
    }
}

/// Returns a rotation refined from coarse to fine.
fn refined(from: &GreySphere, to: &GreySphere, directions: &[Vec3], start: Quat) -> Quat {
    (from.levels().saturating_sub(LEVELS)..from.levels())
        .rev()
        .fold(start, |rotation, level| {
            refine(from, to, level, directions, rotation)
        })
}

fn cost(
    from: &GreySphere,
    to: &GreySphere,
    level: usize,
    directions: &[Vec3],
    rotation: Quat,
) -> f32 {
    directions
        .iter()
        .map(|&d| {
            (to.sample(level, rotation * d) - from.sample(level, d))
                .abs()
                .min(4.0 * HUBER)
        })
        .sum()
}

fn refine(
    from: &GreySphere,
    to: &GreySphere,
    level: usize,
    directions: &[Vec3],
    start: Quat,
) -> Quat {
    let step = to.pixel_radians(level);
    let mut rotation = start;
    for _ in 0..STEPS {
        let mut normal = Mat3::ZERO;
        let mut right = Vec3::ZERO;
        for &direction in directions {
            let turned = rotation * direction;
            let (e, f) = tangents(turned);
            let slope = |axis: Vec3| {
                let ahead = to.sample(level, turned + step * axis);
                let behind = to.sample(level, turned - step * axis);
                (ahead - behind) / (2.0 * step)
            };
            let gradient = slope(e) * e + slope(f) * f;
            // Turning by a small w moves the direction by w x d, and the value by w . (d x g).
            let jacobian = turned.cross(gradient);
            let residual = to.sample(level, turned) - from.sample(level, direction);
            let weight = (HUBER / residual.abs().max(1e-9)).min(1.0);
            normal += weight
                * Mat3::from_cols(
                    jacobian * jacobian.x,
                    jacobian * jacobian.y,
                    jacobian * jacobian.z,
                );
            right += weight * residual * jacobian;
        }
        // An image without any detail determines nothing.
        if normal.determinant().abs() < 1e-12 {
            return rotation;
        }
        let turn = -(normal.inverse() * right);
        rotation = (Quat::from_scaled_axis(turn.clamp_length_max(0.3)) * rotation).normalize();
        if turn.length() < 1e-5 {
            break;
        }
    }
    rotation
}
