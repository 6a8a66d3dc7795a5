//! Motion regularization of static Gaussians (Omni4DGS Eqs. 10 and 11): penalizes changes of the direction in
//! which a static Gaussian is seen.
//!
//! ```text
//! d(t) = (mu(t) - c) / |mu(t) - c|         L_m = sum over G_s of w |d(t + Dt) - d(t)|^2 / Dt^2
//! ```
//!
//! with `Dt` = 1 frame: radians per frame, squared. `c` is the same at both moments. The paper gives neither a
//! sum nor a divisor, so there are two weights `w` of a Gaussian
//! ([`MotionForm`](crate::model::dynamic_settings::MotionForm)). In a mean, `1 / N`, a Gaussian's gradient is too
//! small to act. In a sum over those of a view, in its pixels, it is of the size of a pixel's.
//!
//! Directions of distant Gaussians hardly differ, and those of near, fast ones are almost opposite: both
//! cases must avoid differences of nearly equal numbers. Let `n = |p|`, `n' = |p'|`, and `s = p' - p` the
//! step between both moments. Positions leave the centre `c0` along the velocity, as steps do, so that
//! `p x s = c0 x s`:
//!
//! ```text
//! n' - n = s.(p + p') / (n + n')           e = d' - d = (s - (n' - n) d) / n'           w = d x d' = (c0 x s) / (n n')
//! d|e|^2/dp' = -2 (d' x w) / n'            d|e|^2/dp = 2 (d x w) / n
//! d|e|^2/dc0 = their sum = 2 ((n' - n) d / (n n') - e / n') x w
//! ```

pub(crate) mod gpu;

use glam::Vec3;
use rayon::prelude::*;

use crate::gaussians::{
    periodic::{FrameTime, TemporalGradient, TemporalParameters, TemporalState},
    temporal::{CentreGradient, TemporalTable},
};

/// `Dt`, frames.
const STEP_FRAMES: f32 = 1.0;
/// Distance from the observer below which directions are not defined and not constrained.
const LEAST_DISTANCE: f32 = 1e-6;

/// Returns the value, and the gradients by raw parameters and centres of those `members` that have any, all times
/// the `weight` of one Gaussian.
pub fn motion(
    temporal_table: &TemporalTable<'_>,
    members: &[usize],
    frame: f64,
    cycle: f32,
    weight: f32,
) -> (f64, Vec<CentreGradient>) {
    let origin = temporal_table.observer().centre;
    let parts: Vec<(f32, Option<CentreGradient>)> = members
        .par_iter()
        .with_min_len(1024)
        .map(|&index| {
            let (temporal_parameters, centre) = (
                temporal_table.temporal_parameters(index),
                temporal_table.centre(index) - origin,
            );
            let Some((value, by_temporal, by_centre)) =
                of_one(&temporal_parameters, centre, frame, cycle)
            else {
                return (0.0, None);
            };
            let by_temporal = TemporalGradient {
                peak: weight * by_temporal.peak,
                log_lifespan: weight * by_temporal.log_lifespan,
                velocity: by_temporal.velocity * weight,
            };
            let raw = temporal_table.raw_vjp(index, &by_temporal);
            (value, Some((index, raw, by_centre * weight)))
        })
        .collect();
    let sum: f64 = parts.iter().map(|(value, _)| f64::from(*value)).sum();
    let gradients = parts.into_iter().filter_map(|(_, gradient)| gradient);
    (f64::from(weight) * sum, gradients.collect())
}

/// Returns one Gaussian's `|d(t + Dt) - d(t)|^2 / Dt^2` and its gradients by temporal parameters and by the
/// centre, relative to the observer; `None` if no direction is defined.
pub fn of_one(
    temporal_parameters: &TemporalParameters,
    centre: Vec3,
    frame: f64,
    cycle: f32,
) -> Option<(f32, TemporalGradient, Vec3)> {
    let moments = [frame, frame + f64::from(STEP_FRAMES)].map(FrameTime::at);
    let displacements =
        moments.map(|frame_time| temporal_parameters.at(frame_time, cycle).displacement);
    let [before, after] = displacements.map(|displacement| centre + displacement);
    let [near, far] = [before.length(), after.length()];
    let is_defined = near > LEAST_DISTANCE && far > LEAST_DISTANCE;
    if !is_defined {
        return None;
    }
    let (d_before, d_after) = (before / near, after / far);
    let step = displacements[1] - displacements[0];
    let farther = step.dot(before + after) / (near + far);
    let change = (step - d_before * farther) / far;
    let value = change.length_squared() / (STEP_FRAMES * STEP_FRAMES);
    let turn = centre.cross(step) / (near * far) * (2.0 / (STEP_FRAMES * STEP_FRAMES));
    let by_after = -d_after.cross(turn) / far;
    let by_before = d_before.cross(turn) / near;
    let by_centre = (d_before * (farther / (near * far)) - change / far).cross(turn);
    let mut gradient = TemporalGradient::default();
    for (frame_time, by_position) in moments.into_iter().zip([by_before, by_after]) {
        let upstream = TemporalState {
            displacement: by_position,
            marginal: 0.0,
            mean_velocity: Vec3::ZERO,
        };
        let part = temporal_parameters.at_vjp(frame_time, cycle, &upstream);
        gradient.peak += part.peak;
        gradient.log_lifespan += part.log_lifespan;
        gradient.velocity += part.velocity;
    }
    Some((value, gradient, by_centre))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    const CYCLE: f64 = 10.0;

    /// Returns the loss by its definition in f64, from centre, velocity and peak.
    fn reference(parameters: [f64; 7], frame: f64) -> f64 {
        let [x, y, z, vx, vy, vz, peak] = parameters;
        let direction = |t: f64| {
            let tau = std::f64::consts::TAU;
            let alpha = CYCLE / tau * (tau * (t - peak) / CYCLE).sin();
            (DVec3::new(x, y, z) + DVec3::new(vx, vy, vz) * alpha).normalize()
        };
        (direction(frame + 1.0) - direction(frame)).length_squared()
    }

    #[test]
    fn value_and_gradients_are_those_of_the_definition() {
        let cases = [
            [1.0, 2.0, -1.5, 0.2, -0.1, 0.3, 1.3],
            [0.1, -4.0, 0.2, -0.3, 0.3, 0.1, -2.0],
            [0.0, 3.0, 0.0, 0.5, 0.0, 0.2, 0.0],
        ];
        for (case, frame) in cases.into_iter().zip([0.4, 3.0, -7.0]) {
            let [x, y, z, vx, vy, vz, peak] = case.map(|value| value as f32);
            let temporal_parameters = TemporalParameters {
                peak,
                lifespan: 40.0,
                velocity: Vec3::new(vx, vy, vz),
            };
            let found = of_one(
                &temporal_parameters,
                Vec3::new(x, y, z),
                frame,
                CYCLE as f32,
            );
            let (value, by_temporal, by_centre) = found.expect("defined");
            let expected = reference(case, frame);
            assert!((f64::from(value) - expected).abs() < 1e-5 * (1.0 + expected));
            let gradient = [by_centre.to_array(), by_temporal.velocity.to_array()].concat();
            for (index, found) in gradient.into_iter().chain([by_temporal.peak]).enumerate() {
                let shifted = |step: f64| {
                    let mut shifted = case;
                    shifted[index] += step;
                    reference(shifted, frame)
                };
                let expected = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                let error = (f64::from(found) - expected).abs();
                assert!(
                    error < 2e-4 * (1.0 + expected.abs()),
                    "{index}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn the_observer_itself_and_what_does_not_move_pay_nothing() {
        let still = TemporalParameters {
            peak: 0.0,
            lifespan: f32::INFINITY,
            velocity: Vec3::ZERO,
        };
        assert!(of_one(&still, Vec3::ZERO, 0.0, 10.0).is_none());
        let (value, by_temporal, by_centre) = of_one(&still, Vec3::X, 3.0, 10.0).expect("defined");
        assert_eq!(
            (value, by_temporal.velocity, by_centre),
            (0.0, Vec3::ZERO, Vec3::ZERO)
        );
        // Radial motion: the direction does not change.
        let radial = TemporalParameters {
            velocity: Vec3::X * 0.5,
            ..still
        };
        let (value, ..) = of_one(&radial, Vec3::X * 4.0, 0.3, 10.0).expect("defined");
        assert_eq!(value, 0.0);
    }
}
