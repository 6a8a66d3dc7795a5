//! Separation of a flow into the camera's own motion and a remainder.
//!
//! A static point in direction `d` (unit) at distance `z` is seen by a camera that moves by `t` and turns by a small
//! `w` more than was undone. Its flow is `u = -(t - (t.d) d) / z - w x d`: on the great circle through `d` and `t`,
//! away from the camera's heading. Flow across that circle, or in the opposite direction, is motion of the scene.

use glam::{Mat3, Vec3};
use omnilife_schemas::statistics;

use super::flow::Flow;

/// Rounds of re-weighting.
const ROUNDS: usize = 12;
/// Near the heading and its opposite (sine of the angle) static points hardly move, and every direction of flow is
/// across.
pub(super) const NEAR_EPIPOLE: f32 = 0.15;
/// Residuals above this factor over the usual one are motion.
const OUTLIER_RATIO: f64 = 4.0;
/// A camera whose median flow is below this many pixels does not move.
const STILL_PIXELS: f64 = 0.15;
/// Residuals below this many pixels are never motion.
const LEAST_PIXELS: f64 = 0.35;

/// Motion between two frames.
#[derive(Debug, Clone)]
pub struct PairMotion {
    /// Unit direction of the camera's translation in the first camera's frame; `None` if it does not move.
    pub heading: Option<Vec3>,
    /// Remaining rotation, radians: part of the camera's rotation.
    pub turn: Vec3,
    /// Median flow of static points after all rotation is undone, radians: parallax.
    pub parallax_radians: f64,
    /// Length of each flow vector, in radians, that the camera's motion does not explain; `None` without flow.
    pub unexplained: Vec<Option<f32>>,
    /// Residuals above this are motion in the scene, radians.
    pub limit_radians: f64,
}

impl PairMotion {
    /// Returns true if a flow vector is motion in the scene; `None` without flow.
    pub fn is_dynamic(&self, index: usize) -> Option<bool> {
        self.unexplained[index].map(|residual| f64::from(residual) > self.limit_radians)
    }
}

/// Explains a flow by one motion of the camera. `pixel_radians` is the resolution of the images.
pub fn explain(flow: &[Flow], pixel_radians: f32) -> PairMotion {
    let known: Vec<(Vec3, Vec3)> = flow
        .iter()
        .filter_map(|flow| Some((flow.direction, flow.moved?)))
        .collect();
    let pixel = f64::from(pixel_radians);
    let mut turn = Vec3::ZERO;
    let mut heading: Option<Vec3> = None;
    let mut weights = vec![1.0_f32; known.len()];
    for _ in 0..ROUNDS {
        let left: Vec<(Vec3, Vec3)> = known.iter().map(|&(d, u)| (d, u + turn.cross(d))).collect();
        let lengths: Vec<f64> = left.iter().map(|(_, u)| f64::from(u.length())).collect();
        let moves = statistics::median(&lengths).is_some_and(|m| m > STILL_PIXELS * pixel);
        heading = if moves {
            find_heading(&left, &weights)
        } else {
            None
        };
        turn += find_turn(&left, &weights, heading);
        let residuals = residuals(&known, turn, heading);
        let scale = spread(&residuals).max(0.1 * pixel);
        for (weight, residual) in weights.iter_mut().zip(&residuals) {
            // Tukey's biweight: moving content has no weight.
            let ratio = (f64::from(*residual) / (4.7 * scale)).min(1.0);
            *weight = (1.0 - ratio * ratio).powi(2) as f32;
        }
    }
    let residuals = residuals(&known, turn, heading);
    let limit = (OUTLIER_RATIO * spread(&residuals)).max(LEAST_PIXELS * pixel);
    let still: Vec<f64> = known
        .iter()
        .zip(&residuals)
        .filter(|(_, residual)| f64::from(**residual) <= limit)
        .map(|((d, u), _)| f64::from((*u + turn.cross(*d)).length()))
        .collect();
    let mut found = residuals.into_iter();
    PairMotion {
        heading,
        turn,
        parallax_radians: statistics::median(&still).unwrap_or(0.0),
        unexplained: flow
            .iter()
            .map(|flow| flow.moved.and_then(|_| found.next()))
            .collect(),
        limit_radians: limit,
    }
}

/// Returns the robust standard deviation of residuals, which are lengths.
fn spread(residuals: &[f32]) -> f64 {
    let lengths: Vec<f64> = residuals.iter().map(|&r| f64::from(r)).collect();
    1.4826 * statistics::median(&lengths).unwrap_or(0.0)
}

/// Finds `t` with `t . (u x d) = 0` for all static points: the weakest eigenvector of the weighted sum of `(u x d) (u x
/// d)^T`, by inverse iteration. Its sign is such that most points move away from it.
fn find_heading(flow: &[(Vec3, Vec3)], weights: &[f32]) -> Option<Vec3> {
    let mut sum = Mat3::ZERO;
    for (&(d, u), &weight) in flow.iter().zip(weights) {
        let a = u.cross(d).normalize_or_zero();
        // Longer flow determines its direction better.
        let weight = weight * u.length();
        sum += weight * Mat3::from_cols(a * a.x, a * a.y, a * a.z);
    }
    let trace = sum.col(0).x + sum.col(1).y + sum.col(2).z;
    if trace <= 0.0 {
        return None;
    }
    let inverse = (sum + Mat3::from_diagonal(Vec3::splat(1e-6 * trace))).inverse();
    let mut heading = Vec3::new(0.6, 0.5, 0.62);
    for _ in 0..30 {
        heading = (inverse * heading).normalize_or_zero();
    }
    let votes: f32 = flow
        .iter()
        .zip(weights)
        .map(|(&(_, u), &weight)| -weight * u.dot(heading))
        .sum();
    (heading != Vec3::ZERO).then_some(heading * votes.signum())
}

/// Finds the rotation left in a flow, by least squares over the part across the great circles through `heading`; over
/// all of it without a heading.
fn find_turn(flow: &[(Vec3, Vec3)], weights: &[f32], heading: Option<Vec3>) -> Vec3 {
    let mut normal = Mat3::ZERO;
    let mut right = Vec3::ZERO;
    let mut add = |row: Vec3, value: f32, weight: f32| {
        normal += weight * Mat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += weight * value * row;
    };
    for (&(d, u), &weight) in flow.iter().zip(weights) {
        match heading {
            Some(t) => {
                let across = d.cross(t);
                if across.length() > NEAR_EPIPOLE {
                    let across = across.normalize();
                    // (u + w x d) . a = 0, and (w x d) . a = w . (d x a).
                    add(d.cross(across), -u.dot(across), weight);
                }
            }
            None => {
                for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                    add(d.cross(axis), -u.dot(axis), weight);
                }
            }
        }
    }
    if normal.determinant().abs() < 1e-9 {
        return Vec3::ZERO;
    }
    normal.inverse() * right
}

/// Returns the lengths that a rotation and a heading leave unexplained.
fn residuals(known: &[(Vec3, Vec3)], turn: Vec3, heading: Option<Vec3>) -> Vec<f32> {
    known
        .iter()
        .map(|&(d, u)| {
            let left = u + turn.cross(d);
            let Some(t) = heading else {
                return left.length();
            };
            let along = t - t.dot(d) * d;
            if along.length() < NEAR_EPIPOLE {
                return left.length();
            }
            // Static points move against the camera's motion; the opposite direction is unexplained.
            let against = -left.dot(along.normalize());
            let across = (left.length_squared() - against * against).max(0.0).sqrt();
            across.hypot(against.min(0.0))
        })
        .collect()
}
