//! Dense flow on the sphere after a known rotation: Lucas and Kanade on tangent patches, from
//! coarse to fine.

use glam::{Mat2, Quat, Vec2, Vec3};
use rayon::prelude::*;

use super::grey::{GreySphere, tangents};

/// A patch reaches this many samples to every side.
const REACH: i32 = 3;
/// Steps per level of the pyramid.
const STEPS: usize = 5;
/// Levels of the pyramid that are used, from the largest.
const LEVELS: usize = 3;
/// A patch whose weaker direction has less contrast than this (grey values per sample, RMS) has no determinable flow.
const LEAST_CONTRAST: f32 = 0.008;
/// Mean difference of grey values above which a match is rejected.
const LARGEST_DIFFERENCE: f32 = 0.08;

/// Flow at one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    /// Direction in the first image's camera frame; of length 1.
    pub direction: Vec3,
    /// Displacement in the tangent plane after the rotation is undone, radians; `None` if it cannot be determined.
    pub moved: Option<Vec3>,
}

/// Returns the flow from one image to the other at every given direction, beyond that of `rotation` (first to second
/// camera).
pub fn flow(from: &GreySphere, to: &GreySphere, rotation: Quat, directions: &[Vec3]) -> Vec<Flow> {
    directions
        .par_iter()
        .map(|&direction| Flow {
            direction,
            moved: track(from, to, rotation, direction),
        })
        .collect()
}

fn track(from: &GreySphere, to: &GreySphere, rotation: Quat, direction: Vec3) -> Option<Vec3> {
    let (e, f) = tangents(direction);
    let mut moved = Vec2::ZERO;
    for level in (0..LEVELS.min(from.levels())).rev() {
        moved = match track_level(from, to, level, rotation, [direction, e, f], moved) {
            Ok(moved) => moved,
            // A coarse patch without contrast leaves the work to the finer ones.
            Err(()) if level > 0 => moved,
            Err(()) => return None,
        };
    }
    Some(moved.x * e + moved.y * f)
}

/// Tracks on one level: `frame` is the direction and its tangents, `start` the displacement so far.
fn track_level(
    from: &GreySphere,
    to: &GreySphere,
    level: usize,
    rotation: Quat,
    [direction, e, f]: [Vec3; 3],
    start: Vec2,
) -> Result<Vec2, ()> {
    const SIDE: usize = 2 * REACH as usize + 1;
    let step = from.pixel_radians(level);
    let offset = |index: usize| {
        let (i, j) = ((index % SIDE) as i32 - REACH, (index / SIDE) as i32 - REACH);
        Vec2::new(i as f32, j as f32) * step
    };
    let point = |at: Vec2| direction + at.x * e + at.y * f;
    let mut template = [0.0; SIDE * SIDE];
    for (index, value) in template.iter_mut().enumerate() {
        *value = from.sample(level, point(offset(index)));
    }
    // Slopes of the template, per sample.
    let mut slopes = [Vec2::ZERO; SIDE * SIDE];
    let mut normal = Mat2::ZERO;
    for j in 1..SIDE - 1 {
        for i in 1..SIDE - 1 {
            let at = j * SIDE + i;
            let slope = 0.5
                * Vec2::new(
                    template[at + 1] - template[at - 1],
                    template[at + SIDE] - template[at - SIDE],
                );
            slopes[at] = slope;
            normal += Mat2::from_cols(slope * slope.x, slope * slope.y);
        }
    }
    let inner = ((SIDE - 2) * (SIDE - 2)) as f32;
    let (trace, determinant) = (normal.col(0).x + normal.col(1).y, normal.determinant());
    let weaker = 0.5 * (trace - (trace * trace - 4.0 * determinant).max(0.0).sqrt());
    if weaker < inner * LEAST_CONTRAST * LEAST_CONTRAST {
        return Err(());
    }
    let inverse = normal.inverse();
    let mut moved = start;
    let mut difference = f32::INFINITY;
    for _ in 0..STEPS {
        let mut right = Vec2::ZERO;
        difference = 0.0;
        for j in 1..SIDE - 1 {
            for i in 1..SIDE - 1 {
                let at = j * SIDE + i;
                let seen = to.sample(level, rotation * point(offset(at) + moved));
                let residual = seen - template[at];
                right += residual * slopes[at];
                difference += residual.abs() / inner;
            }
        }
        let change = -(inverse * right) * step;
        // A patch that diverges is lost.
        if !change.is_finite() || (moved + change - start).length() > 4.0 * step {
            return Err(());
        }
        moved += change;
        if change.length() < 0.02 * step {
            break;
        }
    }
    if level == 0 && difference > LARGEST_DIFFERENCE {
        return Err(());
    }
    Ok(moved)
}
