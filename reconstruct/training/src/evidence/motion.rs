//! Residuals of static Gaussians: motion in a scene without masks, and points with changes outside of masks, such
//! as the shadow of a moving object.
//!
//! After a [pilot fit](crate::evidence::pilot) input views are compared with their renders at the images of the
//! same scene points, those that are visible by depth and not masked. The residual of a static scene at a point -
//! too little texture, a wrong colour - is the same in all views. So the evidence is the deviation `d` of a residual
//! from its point's median, channel by channel. Photometric noise is the median of `|d|`. An object or shadow
//! that passes a point deviates by many times as much, in a few views.

use std::fmt;

use omnilife_schemas::statistics;
use rayon::prelude::*;
use serde::Serialize;

use crate::evidence::{LEAST_VIEWS, PER_MEDIAN, PILOT_ITERATIONS, share_of_limits};

/// A deviation is transient above this multiple of the noise, and above this level in grey levels of 1 by day.
const NOISE_FACTOR: f32 = 8.0;
const LEAST_DEVIATION: f32 = 0.1;
/// Minimum number of deviating views of a changing point: one alone may be an edge.
const LEAST_DEVIATING_VIEWS: usize = 2;
/// Minimum share of transient samples for parameters of time, under constant light. Reflections that run over
/// glossy ground are transient too, and gain from these parameters as pedestrians do (docs/results/evidence.md).
const TRANSIENT_SHARE: f64 = 0.0008;
/// Number of standard errors by which the share has to exceed that minimum: few samples give little evidence.
const STANDARD_ERRORS: f64 = 2.0;

/// Evidence of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MotionEvidence {
    /// Compared points in views, channel by channel.
    pub samples: usize,
    /// Photometric noise: standard deviation, grey levels in `[0, 1]`.
    pub noise: f32,
    /// Share of transient samples, which deviate by far more than the noise.
    pub transient_share: f64,
    /// Minimum deviation of a transient sample at any noise, grey levels in `[0, 1]`; smaller in dark scenes.
    pub least_deviation: f32,
}

impl MotionEvidence {
    /// Returns true if something moves, or may: without samples nothing decides.
    pub fn moves(&self) -> bool {
        self.samples == 0 || self.transient_share >= self.share_limit()
    }

    /// Returns the minimum share of transient samples for motion. They are rare events: their number varies by
    /// the root of the expectation.
    fn share_limit(&self) -> f64 {
        let expected = TRANSIENT_SHARE * self.samples as f64;
        (expected + STANDARD_ERRORS * expected.sqrt()) / self.samples.max(1) as f64
    }

    /// Returns the minimum deviation of a transient sample.
    fn limit(&self) -> f32 {
        (NOISE_FACTOR * self.noise).max(self.least_deviation)
    }
}

impl fmt::Display for MotionEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.samples == 0 {
            return out.write_str(
                "no scene point is seen by enough views to tell whether something moves",
            );
        }
        write!(
            out,
            "after {PILOT_ITERATIONS} static iterations {:.2} % of {} samples at scene points \
             deviate from their point's median by {NOISE_FACTOR} times the noise of {:.4} or more \
             (limit {:.2} %)",
            100.0 * self.transient_share,
            self.samples,
            self.noise,
            100.0 * self.share_limit()
        )
    }
}

/// Points that change, with their evidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChangingPoints {
    /// Evidence of all points.
    pub evidence: MotionEvidence,
    /// Number of points that change.
    pub changing: usize,
    /// Number of points that too few views see. They count as unchanged.
    pub unknown: usize,
    /// Per point, true if it changes.
    #[serde(skip)]
    pub changes: Vec<bool>,
}

impl ChangingPoints {
    /// Finds the changing points, from the residuals of each in the views that see it: one series per point and
    /// channel. `median_level` is that of the scene.
    pub(crate) fn of(residuals: &[Vec<f32>], median_level: f32) -> Self {
        let evidence = transients(residuals, median_level);
        let limit = evidence.limit();
        let changes: Vec<bool> = residuals
            .chunks_exact(3)
            .map(|channels| {
                channels.iter().any(|residuals| {
                    let deviating = deviations(residuals).filter(|deviation| *deviation >= limit);
                    deviating.count() >= LEAST_DEVIATING_VIEWS
                })
            })
            .collect();
        let is_unknown = |channels: &&[Vec<f32>]| channels[0].len() < LEAST_VIEWS;
        Self {
            evidence,
            changing: changes.iter().filter(|&&changes| changes).count(),
            unknown: residuals.chunks_exact(3).filter(is_unknown).count(),
            changes,
        }
    }
}

impl fmt::Display for ChangingPoints {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "{} of {} scene points change outside the masks: after {PILOT_ITERATIONS} static \
             iterations their residuals deviate in {LEAST_DEVIATING_VIEWS} views or more from the \
             point's median by {NOISE_FACTOR} times the noise of {:.4}, or by {:.3}, whichever is more",
            self.changing,
            self.changes.len(),
            self.evidence.noise,
            self.evidence.least_deviation
        )?;
        if self.unknown > 0 {
            let unknown = self.unknown;
            write!(
                out,
                "; {unknown} that fewer than {LEAST_VIEWS} views see are taken not to"
            )?;
        }
        Ok(())
    }
}

/// Returns the evidence from the residuals of every point in a scene of a median level.
pub(crate) fn transients(residuals: &[Vec<f32>], median_level: f32) -> MotionEvidence {
    let mut deviations: Vec<f32> = residuals
        .par_iter()
        .flat_map_iter(|residuals| deviations(residuals))
        .collect();
    if deviations.is_empty() {
        return MotionEvidence::default();
    }
    let middle = deviations.len() / 2;
    let (_, median, _) = deviations.select_nth_unstable_by(middle, f32::total_cmp);
    let noise = PER_MEDIAN * *median;
    let mut evidence = MotionEvidence {
        samples: deviations.len(),
        noise,
        transient_share: 0.0,
        least_deviation: LEAST_DEVIATION * share_of_limits(median_level),
    };
    let limit = evidence.limit();
    let transient = deviations.iter().filter(|&&deviation| deviation >= limit);
    evidence.transient_share = transient.count() as f64 / deviations.len() as f64;
    evidence
}

/// Returns the deviations from a point's median; empty if too few views see it.
fn deviations(residuals: &[f32]) -> impl Iterator<Item = f32> {
    let seen = if residuals.len() >= LEAST_VIEWS {
        residuals
    } else {
        &[]
    };
    let median = statistics::median(seen).unwrap_or(0.0);
    seen.iter().map(move |residual| (residual - median).abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_in_every_view_is_no_motion() {
        // Every point has an error of its own, and one in twenty a passing object in one view.
        let point = |number: usize, passes: bool| -> Vec<f32> {
            let own = 0.3 * ((number % 7) as f32 - 3.0);
            let noise = |view: usize| 0.01 * ((view * 5 + number) % 3) as f32;
            (0..10)
                .map(|view| own + noise(view) + if passes && view == 4 { 0.5 } else { 0.0 })
                .collect()
        };
        let all = |share: usize| -> Vec<Vec<f32>> {
            (0..200)
                .map(|n| point(n, share > 0 && n % share == 0))
                .collect()
        };
        let still = transients(&all(0), 0.5);
        assert_eq!((still.samples, still.transient_share), (2_000, 0.0));
        assert!(!still.moves() && still.noise < 0.03);
        let moving = transients(&all(20), 0.5);
        assert!(
            (moving.transient_share - 0.005).abs() < 1e-9 && moving.moves(),
            "{moving:?}"
        );
    }

    /// Checks that what passes a place of level 0.06 and adds as much again is motion by night, and noise by day.
    #[test]
    fn at_night_smaller_deviations_are_motion() {
        let point = |number: usize| -> Vec<f32> {
            let noise = |view: usize| 0.001 * ((view * 5 + number) % 3) as f32;
            let passing = |view: usize| {
                if view == 4 && number.is_multiple_of(20) {
                    0.06
                } else {
                    0.0
                }
            };
            (0..10).map(|view| noise(view) + passing(view)).collect()
        };
        let all: Vec<Vec<f32>> = (0..200).map(point).collect();
        let [night, day] = [0.06, 0.4].map(|level| transients(&all, level));
        assert!(night.moves() && !day.moves(), "{night} {day}");
    }

    #[test]
    fn points_that_few_views_see_are_counted() {
        let seen = [vec![0.1; 8], vec![0.1; 8], vec![0.1; 8]];
        let hidden = [vec![0.1; 5], vec![0.1; 5], vec![0.1; 5]];
        let found = ChangingPoints::of(&[seen.as_slice(), &hidden, &hidden].concat(), 0.5);
        assert_eq!(
            (found.changing, found.unknown, found.changes.len()),
            (0, 2, 3)
        );
        let text = found.to_string();
        assert!(text.contains("; 2 that fewer than 6 views see"), "{text}");
    }

    #[test]
    fn without_samples_it_may_move() {
        let nothing = transients(&[vec![0.1; 3], vec![0.2; 5]], 0.5);
        assert!(nothing.samples == 0 && nothing.moves());
        assert!(nothing.to_string().contains("no scene point"));
    }
}
