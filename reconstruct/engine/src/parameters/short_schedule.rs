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
//!
//! Every array states its exponents `b` and `e` beside its rate ([`LearningRate`]), or that it has none: an array
//! cannot have a rate without them.

use serde::{Deserialize, Serialize};

use super::{adam::SecondMomentDecay, decay::Decay};

/// Upper bound of `f`. Schedules below 1/49 of the published one do not gain from larger steps: opacities
/// overshoot, and Gaussians are pruned.
const LARGEST_FACTOR: f64 = 7.0;

/// Growth of an array's steps in a schedule shorter than the published one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Growth {
    /// Exponents of `f` at the begin and at the end of the run.
    Exponents {
        /// `b`.
        begin: f32,
        /// `e`.
        end: f32,
    },
    /// The rate is the same in every schedule.
    Unchanged,
}

impl Growth {
    /// Growth of parameters that start far from their final values, and settle.
    pub const SETTLING: Self = Self::exponents(1.0, 0.5);
    /// Growth of parameters whose published rate falls by two decades, which a short schedule cannot afford.
    pub const LASTING: Self = Self::exponents(1.0, 1.5);
    /// Growth of parameters that go as far as a random walk of the published number of steps.
    pub const EVEN: Self = Self::exponents(1.0, 1.0);

    /// Creates a growth by its exponents.
    pub const fn exponents(begin: f32, end: f32) -> Self {
        Self::Exponents { begin, end }
    }

    /// Returns the value for records of versions that did not state it. Their models are drawn, not trained.
    const fn of_older_records() -> Self {
        Self::Unchanged
    }
}

/// A rate in the published schedule, with its growth in shorter ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LearningRate {
    /// The rate in the published schedule.
    #[serde(flatten)]
    pub published: Decay,
    /// Its growth in shorter schedules.
    #[serde(default = "Growth::of_older_records")]
    pub growth: Growth,
}

impl LearningRate {
    /// Creates a rate that grows in shorter schedules.
    pub const fn new(published: Decay, growth: Growth) -> Self {
        Self { published, growth }
    }

    /// Creates a rate that is the same in every schedule.
    pub const fn unchanged(published: Decay) -> Self {
        Self::new(published, Growth::Unchanged)
    }
}

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

    /// Returns the step size after a share of a run of this many steps.
    pub fn rate(&self, rate: &LearningRate, share: f32, iterations: f64) -> f32 {
        let published = rate.published.at(share);
        match rate.growth {
            Growth::Unchanged => published,
            Growth::Exponents { begin, end } => {
                let share = share.clamp(0.0, 1.0);
                let exponent = begin * (1.0 - share) + end * share;
                published * self.factor(iterations).powf(exponent)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: ShortSchedule = ShortSchedule {
        published_iterations: 30_000.0,
    };
    const LARGE_FIRST: Growth = Growth::exponents(1.5, 1.0);

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
        for growth in [
            Growth::SETTLING,
            Growth::LASTING,
            Growth::EVEN,
            LARGE_FIRST,
            Growth::Unchanged,
        ] {
            let rate = LearningRate::new(decay, growth);
            for share in [0.0, 0.3, 1.0] {
                for iterations in [30_000.0, 100_000.0] {
                    let found = SHORT.rate(&rate, share, iterations);
                    assert_eq!(found.to_bits(), decay.at(share).to_bits(), "{growth:?}");
                }
            }
        }
    }

    #[test]
    fn fewer_steps_begin_with_larger_ones_and_settle() {
        let decay = Decay::constant(1e-3);
        let rate = |growth, share| SHORT.rate(&LearningRate::new(decay, growth), share, 1_200.0);
        let near = |found: f32, expected: f32| (found / expected - 1.0).abs() < 1e-4;
        assert!(near(rate(Growth::SETTLING, 0.0), 5e-3));
        assert!(near(rate(Growth::SETTLING, 1.0), 1e-3 * 5.0_f32.sqrt()));
        assert!(near(rate(LARGE_FIRST, 0.0), 1e-3 * 5.0_f32.powf(1.5)));
        assert!(near(rate(Growth::LASTING, 1.0), 1e-3 * 5.0_f32.powf(1.5)));
        assert!(near(rate(Growth::EVEN, 0.3), 5e-3));
        assert_eq!(rate(Growth::Unchanged, 0.0), decay.at(0.0));
        assert!(near(1.0 - SHORT.second_moments(1_200.0).0, 25.0 * 1e-3));
        // Zero steps must not divide by zero.
        for iterations in [0.0, 10.0, 500.0] {
            assert_eq!(SHORT.factor(iterations), 7.0);
        }
    }

    #[test]
    fn a_rate_is_recorded_with_its_growth_and_read_back() {
        let rate = LearningRate::new(Decay::constant(1e-3), Growth::LASTING);
        let text = serde_json::to_string(&rate).expect("JSON");
        assert!(
            text.contains("begin") && text.contains("exponents"),
            "{text}"
        );
        assert_eq!(serde_json::from_str::<LearningRate>(&text).ok(), Some(rate));
        let older = serde_json::from_str::<LearningRate>(r#"{"begin": 0.1, "end": 0.01}"#);
        assert_eq!(older.map(|rate| rate.growth).ok(), Some(Growth::Unchanged));
    }
}
