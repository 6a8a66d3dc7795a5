//! Step sizes in schedules shorter than the published one.
//!
//! Rates of 3DGS are tuned for 30,000 steps. In a shorter schedule of `N` steps, parameters have to travel as
//! far in fewer of them. With
//!
//! ```text
//! f = sqrt(N_published / N), 1 at least and 7 at most
//! rate = published rate * f^(b (1 - share) + e share)
//! ```
//!
//! the published schedule is unchanged, and shorter ones take larger steps: with `b = e = 1` they go as far
//! as a random walk of the published number of steps. Constant rates end at `e = 1/2`, so that they settle.
//! Rates of positions and peak times, published to fall by two decades, fall by less. Sizes, which start far
//! from their final values, start with larger steps. The exponents were found by experiment
//! (`docs/results/quality.md`).

use serde::{Deserialize, Serialize};

use super::{adam::SecondMomentDecay, decay::Decay};

/// Exponents `b` and `e` by name of the parameter array. Other arrays keep their rates.
const EXPONENTS: &[(&str, f32, f32)] = &[
    ("positions", 1.0, 1.5),
    ("log_scales", 1.5, 1.0),
    ("quaternions", 1.0, 0.5),
    ("opacity_logits", 1.0, 0.5),
    ("sh_constant", 1.0, 0.5),
    ("sh_rest", 1.0, 0.5),
    ("peak_times", 1.0, 1.5),
    ("log_lifespans", 1.0, 1.0),
    ("velocities", 1.0, 0.5),
    ("radial_velocities", 1.0, 0.5),
    ("tangential_velocities", 1.0, 0.5),
];

/// Upper bound of `f`. Schedules below 1/49 of the published one do not gain from larger steps: opacities
/// overshoot, and Gaussians are pruned.
const LARGEST_FACTOR: f64 = 7.0;

/// Larger steps in schedules shorter than the published one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShortSchedule {
    /// Number of steps of the published schedule.
    pub published_iterations: f64,
}

impl ShortSchedule {
    /// Returns `f` for a run of this many steps.
    pub fn factor(&self, iterations: f64) -> f32 {
        let shorter = self.published_iterations / iterations.max(1.0);
        shorter.sqrt().clamp(1.0, LARGEST_FACTOR) as f32
    }

    /// Returns the decay of second moments, whose memory is shortened to the same share of a run: `f^2` times
    /// fewer steps.
    pub fn second_moments(&self, iterations: f64) -> SecondMomentDecay {
        let SecondMomentDecay(published) = SecondMomentDecay::PUBLISHED;
        SecondMomentDecay(1.0 - (1.0 - published) * self.factor(iterations).powi(2))
    }

    /// Returns the rate of an array after a share of a run of this many steps.
    pub fn rate(&self, array: &str, published: &Decay, share: f32, iterations: f64) -> f32 {
        let rate = published.at(share);
        let known = EXPONENTS.iter().find(|(name, ..)| *name == array);
        known.map_or(rate, |&(_, begin, end)| {
            let share = share.clamp(0.0, 1.0);
            rate * self
                .factor(iterations)
                .powf(begin * (1.0 - share) + end * share)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: ShortSchedule = ShortSchedule {
        published_iterations: 30_000.0,
    };

    #[test]
    fn the_published_schedule_and_longer_ones_keep_their_rates() {
        let decay = Decay {
            begin: 1.6e-4,
            end: 1.6e-6,
        };
        for iterations in [30_000.0, 100_000.0] {
            let moments = SHORT.second_moments(iterations);
            assert_eq!(
                moments.0.to_bits(),
                SecondMomentDecay::PUBLISHED.0.to_bits()
            );
        }
        for (name, ..) in EXPONENTS {
            for share in [0.0, 0.3, 1.0] {
                for iterations in [30_000.0, 100_000.0] {
                    let rate = SHORT.rate(name, &decay, share, iterations);
                    assert_eq!(rate.to_bits(), decay.at(share).to_bits(), "{name}");
                }
            }
        }
    }

    #[test]
    fn fewer_steps_begin_with_larger_ones_and_settle() {
        let decay = Decay::constant(1e-3);
        let rate = |array, share| SHORT.rate(array, &decay, share, 1_200.0);
        let near = |found: f32, expected: f32| (found / expected - 1.0).abs() < 1e-4;
        assert!(near(rate("sh_constant", 0.0), 5e-3));
        assert!(near(rate("sh_constant", 1.0), 1e-3 * 5.0_f32.sqrt()));
        assert!(near(rate("log_scales", 0.0), 1e-3 * 5.0_f32.powf(1.5)));
        assert!(near(rate("positions", 1.0), 1e-3 * 5.0_f32.powf(1.5)));
        assert_eq!(rate("weights", 0.0), decay.at(0.0));
        assert!(near(rate("log_lifespans", 0.3), 5e-3));
        assert!(near(1.0 - SHORT.second_moments(1_200.0).0, 25.0 * 1e-3));
        // Zero steps must not divide by zero.
        for iterations in [0.0, 10.0, 500.0] {
            assert_eq!(SHORT.factor(iterations), 7.0);
        }
    }
}
