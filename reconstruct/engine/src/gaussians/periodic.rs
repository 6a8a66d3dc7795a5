//! The motion of PVG: a Gaussian that appears around its peak time and vibrates about its centre.
//!
//! Source: Chen et al., "Periodic Vibration Gaussian", 2023, and its repository (fudan-zvg/PVG,
//! `scene/gaussian_model.py`); Omni4DGS Eqs. 1 and 2 are the same. With the time `t`, the peak time `tau`,
//! the lifespan `beta`, the velocity `v` and the cycle `l`, all times in frames:
//!
//! ```text
//! d = t - tau                              alpha(d) = l/(2 pi) sin(2 pi d / l)
//! mu(t) = mu + alpha(d) v                  (1)
//! o(t)  = o m(d),   m = exp(-(d/beta)^2/2) (2)
//! rho   = beta / l                         staticness: small for short-lived ones
//! vbar  = v exp(-rho/2)                    mean velocity
//! ```
//!
//! PVG's temporal smoothing renders the state at the time `t - s`, moved on by `s vbar`, and compares it with
//! the image at `t`: [`FrameTime::shift`] is `s`.
//!
//! A Gaussian whose opacity does not depend on time has an infinite lifespan: `m = 1`, `rho` is infinite,
//! `vbar = 0`.

use std::f32::consts::TAU;

use glam::Vec3;

/// Time of an image, and shift of the state drawn in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// The image's time, frames.
    pub frame: f64,
    /// Shift of the drawn state into the past, frames; 0 without temporal smoothing.
    pub shift: f32,
}

impl FrameTime {
    /// Returns a time without shift.
    pub fn at(frame: f64) -> Self {
        Self { frame, shift: 0.0 }
    }
}

/// The temporal parameters of one Gaussian, activated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalParameters {
    /// Time of the highest opacity, frames.
    pub peak: f32,
    /// Standard deviation of the opacity over time, frames, positive; infinite where it is constant.
    pub lifespan: f32,
    /// Velocity at the peak, units per frame.
    pub velocity: Vec3,
}

/// State of a Gaussian with [`TemporalParameters`] at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalState {
    /// Offset of the centre.
    pub displacement: Vec3,
    /// Factor of the opacity, `m` in [0, 1].
    pub marginal: f32,
    /// `vbar`, units per frame.
    pub mean_velocity: Vec3,
}

/// Gradients by the parameters of a [`TemporalParameters`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TemporalGradient {
    /// Gradient by the peak time.
    pub peak: f32,
    /// Gradient by the logarithm of the lifespan.
    pub log_lifespan: f32,
    /// Gradient by the velocity.
    pub velocity: Vec3,
}

/// Returns `l/(2 pi) sin(2 pi d / l)` and its derivative. Whole cycles are removed in f64: after thousands of
/// them between peak and moment, f32 would have no precision left for the angle.
fn vibration(distance: f64, cycle: f32) -> (f32, f32) {
    let cycles = distance / f64::from(cycle);
    let angle = TAU * (cycles - cycles.round()) as f32;
    (cycle / TAU * angle.sin(), angle.cos())
}

impl TemporalParameters {
    /// Returns `rho`, the staticness.
    pub fn staticness(&self, cycle: f32) -> f32 {
        self.lifespan / cycle
    }

    /// Returns `d`, frames from the peak to the drawn state.
    fn distance(&self, frame_time: FrameTime) -> f64 {
        frame_time.frame - f64::from(frame_time.shift) - f64::from(self.peak)
    }

    /// Returns `m` after `distance` frames from the peak.
    pub fn marginal(&self, distance: f32) -> f32 {
        let ratio = distance / self.lifespan;
        (-0.5 * ratio * ratio).exp()
    }

    /// Returns `exp(-rho/2)`, the ratio of mean velocity to velocity.
    pub fn steadiness(&self, cycle: f32) -> f32 {
        (-0.5 * self.staticness(cycle)).exp()
    }

    /// Returns the state at a moment; `cycle` is `l` in frames.
    pub fn at(&self, frame_time: FrameTime, cycle: f32) -> TemporalState {
        let distance = self.distance(frame_time);
        let mean_velocity = self.velocity * self.steadiness(cycle);
        TemporalState {
            displacement: self.velocity * vibration(distance, cycle).0
                + mean_velocity * frame_time.shift,
            marginal: self.marginal(distance as f32),
            mean_velocity,
        }
    }

    /// Computes the VJP of [`TemporalParameters::at`] from the gradient by the state.
    pub fn at_vjp(
        &self,
        frame_time: FrameTime,
        cycle: f32,
        upstream: &TemporalState,
    ) -> TemporalGradient {
        let distance = self.distance(frame_time);
        let (amplitude, slope) = vibration(distance, cycle);
        let distance = distance as f32;
        let ratio = distance / self.lifespan;
        let marginal = self.marginal(distance);
        let steadiness = self.steadiness(cycle);
        let by_mean = upstream.mean_velocity + upstream.displacement * frame_time.shift;
        // d exp(-rho/2) / d ln beta; written so that an infinite lifespan gives 0.
        let by_log_steadiness = if steadiness > 0.0 {
            -0.5 * self.staticness(cycle) * steadiness
        } else {
            0.0
        };
        // If the exponential underflows to 0, so do its derivatives, even if the ratio is infinite.
        let (by_distance, by_log_ratio) = if marginal > 0.0 {
            (
                upstream.marginal * marginal * ratio / self.lifespan,
                upstream.marginal * marginal * ratio * ratio,
            )
        } else {
            (0.0, 0.0)
        };
        TemporalGradient {
            peak: by_distance - slope * self.velocity.dot(upstream.displacement),
            log_lifespan: by_log_ratio + by_log_steadiness * self.velocity.dot(by_mean),
            velocity: upstream.displacement * amplitude + by_mean * steadiness,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns displacement, marginal and mean velocity by the definition in f64.
    fn reference(
        [peak, log_lifespan]: [f64; 2],
        v: [f64; 3],
        cycle: f64,
        t: f64,
        s: f64,
    ) -> [f64; 7] {
        let tau = std::f64::consts::TAU;
        let (d, beta) = (t - s - peak, log_lifespan.exp());
        let alpha = cycle / tau * (tau * d / cycle).sin();
        let mean = v.map(|v| v * (-0.5 * beta / cycle).exp());
        let m = (-0.5 * (d / beta).powi(2)).exp();
        let at = |axis: usize| alpha * v[axis] + s * mean[axis];
        [at(0), at(1), at(2), m, mean[0], mean[1], mean[2]]
    }

    fn values(state: &TemporalState) -> [f32; 7] {
        let ([a, b, c], [x, y, z]) = (
            state.displacement.to_array(),
            state.mean_velocity.to_array(),
        );
        [a, b, c, state.marginal, x, y, z]
    }

    proptest! {
        #[test]
        fn state_and_gradient_are_those_of_the_definition(
            peak in -30.0..30.0_f64,
            log_lifespan in -0.5..4.0_f64,
            v in prop::array::uniform3(-0.5..0.5_f64),
            cycle in 3.0..80.0_f64,
            t in -30.0..30.0_f64,
            s in -1.5..1.5_f64,
            upstream in prop::array::uniform7(-1.0..1.0_f64),
        ) {
            let temporal_parameters = TemporalParameters {
                peak: peak as f32,
                lifespan: log_lifespan.exp() as f32,
                velocity: glam::DVec3::from_array(v).as_vec3(),
            };
            let frame_time = FrameTime { frame: t, shift: s as f32 };
            let state = temporal_parameters.at(frame_time, cycle as f32);
            let expected = reference([peak, log_lifespan], v, cycle, t, s);
            for (value, expected) in values(&state).iter().zip(expected) {
                prop_assert!((f64::from(*value) - expected).abs() < 2e-5, "{value} {expected}");
            }
            let g = upstream.map(|value| value as f32);
            let gradient = temporal_parameters.at_vjp(frame_time, cycle as f32, &TemporalState {
                displacement: Vec3::new(g[0], g[1], g[2]),
                marginal: g[3],
                mean_velocity: Vec3::new(g[4], g[5], g[6]),
            });
            let found = [
                gradient.peak,
                gradient.log_lifespan,
                gradient.velocity.x,
                gradient.velocity.y,
                gradient.velocity.z,
            ];
            let loss = |parameters: [f64; 5]| -> f64 {
                let [peak, log_lifespan, x, y, z] = parameters;
                reference([peak, log_lifespan], [x, y, z], cycle, t, s)
                    .iter()
                    .zip(upstream)
                    .map(|(value, weight)| value * weight)
                    .sum()
            };
            let parameters = [peak, log_lifespan, v[0], v[1], v[2]];
            for (index, found) in found.iter().enumerate() {
                let h = 1e-5;
                let shifted = |step: f64| {
                    let mut shifted = parameters;
                    shifted[index] += step;
                    loss(shifted)
                };
                let expected = (shifted(h) - shifted(-h)) / (2.0 * h);
                prop_assert!(
                    (f64::from(*found) - expected).abs() < 1e-4 * (1.0 + expected.abs()),
                    "parameter {index}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn extremes_stay_finite_and_within_bounds() {
        let gradient = TemporalState {
            displacement: Vec3::ONE,
            marginal: 1.0,
            mean_velocity: Vec3::ONE,
        };
        for lifespan in [0.25, 1.0, 1e6, f32::INFINITY] {
            for cycle in [1e-3, 10.0, 1e9] {
                for peak in [0.0, -5e3, 1e4, 1e7] {
                    for frame in [-5e3, 0.0, 0.5, 5e3] {
                        let temporal_parameters = TemporalParameters {
                            peak,
                            lifespan,
                            velocity: Vec3::new(0.2, -0.1, 0.3),
                        };
                        let frame_time = FrameTime { frame, shift: 1.5 };
                        let state = temporal_parameters.at(frame_time, cycle);
                        assert!(
                            (0.0..=1.0).contains(&state.marginal),
                            "{temporal_parameters:?}"
                        );
                        let reach = (cycle / TAU).min((frame as f32 - peak).abs() + 2.0) + 1.5;
                        assert!(
                            state.displacement.length() <= 0.4 * reach,
                            "{temporal_parameters:?} {cycle} {frame}: {state:?}"
                        );
                        let back = temporal_parameters.at_vjp(frame_time, cycle, &gradient);
                        assert!(
                            back.peak.is_finite()
                                && back.log_lifespan.is_finite()
                                && back.velocity.is_finite(),
                            "{temporal_parameters:?} {cycle} {frame}: {back:?}"
                        );
                    }
                }
            }
        }
    }

    /// With a peak a million frames away, f32 would have an error of three hundredths of a frame. With a
    /// cycle of a thousandth of a frame, it would have one of a ten-thousandth of a turn.
    #[test]
    fn many_cycles_between_peak_and_moment_leave_the_angle_exact() {
        for (peak, cycle, frame) in [
            (1e6, 10.0, 0.37),
            (-1e6, 7.3, 12.1),
            (4_321.7, 1e-3, -4_000.3),
            (0.3, 1e-6, 1.1),
        ] {
            let temporal_parameters = TemporalParameters {
                peak,
                lifespan: f32::INFINITY,
                velocity: Vec3::X,
            };
            let distance = frame - f64::from(peak);
            let cycles = distance / f64::from(cycle);
            let angle = std::f64::consts::TAU * (cycles - cycles.round());
            let upstream = TemporalState {
                displacement: Vec3::X,
                marginal: 0.0,
                mean_velocity: Vec3::ZERO,
            };
            let frame_time = FrameTime::at(frame);
            let turn = temporal_parameters.at(frame_time, cycle).displacement.x * TAU / cycle;
            let back = temporal_parameters.at_vjp(frame_time, cycle, &upstream);
            assert!(
                (f64::from(turn) - angle.sin()).abs() < 1e-6,
                "{peak} {cycle}"
            );
            assert!(
                (f64::from(back.peak) + angle.cos()).abs() < 1e-6,
                "{peak} {cycle}"
            );
        }
    }

    #[test]
    fn a_constant_opacity_is_the_limit_of_long_lifespans() {
        let temporal_parameters = |lifespan| TemporalParameters {
            peak: 3.0,
            lifespan,
            velocity: Vec3::X,
        };
        let frame_time = FrameTime::at(-20.0);
        let (long, constant) = (
            temporal_parameters(1e7).at(frame_time, 10.0),
            temporal_parameters(f32::INFINITY).at(frame_time, 10.0),
        );
        assert_eq!(long, constant);
        assert_eq!(
            (constant.marginal, constant.mean_velocity),
            (1.0, Vec3::ZERO)
        );
    }
}
