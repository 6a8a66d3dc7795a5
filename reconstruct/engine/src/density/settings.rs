//! When Gaussians are added and removed.

use serde::{Deserialize, Serialize};

use crate::{model::Part, schedule::Position};

/// Density control of a run. Iterations are those of the schedule, intervals of densification real
/// ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DensifySettings {
    /// First iteration at which Gaussians may be added or removed.
    pub begin_iteration: u64,
    /// Last one.
    pub end_iteration: u64,
    /// Iterations from one densification to the next.
    pub interval_iterations: u64,
    /// Iterations from one opacity reset to the next; 0 never resets.
    pub opacity_reset_iterations: u64,
    /// Real iterations that opacities must have to recover from a reset; without them there is none.
    pub opacity_recovery_iterations: u64,
    /// Mean image-space gradient (normalized device coordinates) from which a Gaussian is cloned
    /// or split.
    pub gradient_threshold: Threshold,
    /// What sizes are compared with.
    pub size_unit: SizeUnit,
    /// Largest axis up to which a Gaussian is cloned, above which it is split.
    pub clone_size: f32,
    /// Largest axis above which a Gaussian is pruned.
    pub prune_size: f32,
    /// Last iteration at which no Gaussian is pruned for its size.
    pub prune_size_begin_iteration: u64,
    /// Opacity below which a Gaussian is pruned.
    pub prune_opacity: f32,
    /// No Gaussian is added above this number.
    pub maximum_gaussians: u64,
}

/// A threshold that may depend on latitude: `equator + (1 - cos lat) (pole - equator)` (ODGS
/// `scene/gaussian_model.py`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// At the equator.
    pub equator: f32,
    /// At the poles.
    pub pole: f32,
    /// Whose latitude.
    pub latitude: LatitudeOf,
}

/// Whose latitude a threshold depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LatitudeOf {
    /// The Gaussian's own: the mean of `cos lat` over all input views.
    AllViews,
    /// As the view rendered last sees it, as ODGS publishes it, although the gradients come from
    /// many views.
    LastView,
}

/// What sizes are compared with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SizeUnit {
    /// The Gaussian's distance from the nearest input camera, that of neighbouring cameras at least: it
    /// holds in scenes many times as large as the cameras' path, and on long paths past things that are
    /// near.
    Distance,
    /// A length in normalized units: the extent of the cameras in 3DGS, 100 world units more in
    /// ODGS.
    Length(f32),
}

impl Threshold {
    /// The same everywhere.
    pub const fn constant(value: f32) -> Self {
        Self {
            equator: value,
            pole: value,
            latitude: LatitudeOf::AllViews,
        }
    }

    /// The threshold where the cosine of the latitude is `cos_latitude`.
    pub fn at(&self, cos_latitude: f32) -> f32 {
        self.equator + (1.0 - cos_latitude) * (self.pole - self.equator)
    }
}

impl DensifySettings {
    /// Those of a part: its own unit of length, where it has one.
    pub(super) fn of_part(&self, part: &Part) -> Self {
        let unit = part.parameterization.unit_length();
        Self {
            size_unit: unit.map_or(self.size_unit, SizeUnit::Length),
            ..self.clone()
        }
    }

    /// Whether Gaussians are to be added and removed now.
    pub fn is_due(&self, position: &Position) -> bool {
        (self.begin_iteration..=self.end_iteration).contains(&position.scheduled)
            && position
                .iteration
                .is_multiple_of(self.interval_iterations.max(1))
    }

    /// Whether opacities are to be reset now; `last` is the iteration of the schedule at which it was
    /// done last.
    ///
    /// Under a time budget the schedule may run so fast that opacities could not recover: then they
    /// are not reset.
    pub fn resets_opacities(&self, position: &Position, last: u64) -> bool {
        let every = self.opacity_reset_iterations;
        every > 0
            && position.scheduled < self.end_iteration
            && position.scheduled / every > last / every
            && position.real_iterations(every) >= self.opacity_recovery_iterations
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The schedule of 3DGS over 30,000 iterations.
    pub(crate) fn published() -> DensifySettings {
        DensifySettings {
            begin_iteration: 500,
            end_iteration: 15_000,
            interval_iterations: 100,
            opacity_reset_iterations: 3_000,
            opacity_recovery_iterations: 500,
            gradient_threshold: Threshold::constant(2e-4),
            size_unit: SizeUnit::Length(1.1),
            clone_size: 0.01,
            prune_size: 0.1,
            prune_size_begin_iteration: 3_000,
            prune_opacity: 0.005,
            maximum_gaussians: u64::MAX,
        }
    }

    /// Iterations of resets where each takes a tenth of a second.
    fn resets(budget_seconds: Option<f64>) -> Vec<u64> {
        let (settings, iterations) = (published(), 30_000);
        let (mut last, mut resets) = (0, Vec::new());
        for iteration in 1..=iterations {
            let seconds = 0.1 * iteration as f64;
            if budget_seconds.is_some_and(|budget| seconds > budget) {
                break;
            }
            let position = Position::new(iterations, budget_seconds, iteration, seconds);
            if settings.resets_opacities(&position, last) {
                last = position.scheduled;
                resets.push(iteration);
            }
        }
        resets
    }

    #[test]
    fn opacities_are_reset_as_published_and_as_often_within_a_budget() {
        assert_eq!(resets(None), [3_000, 6_000, 9_000, 12_000]);
        // A third of the iterations fit.
        let found = resets(Some(1_000.0));
        assert_eq!(found.len(), 4, "{found:?}");
        assert!(found[0].abs_diff(1_000) <= 1 && found[3].abs_diff(4_000) <= 1);
        // Only 1,000 fit: 100 iterations between resets are too few.
        assert!(resets(Some(100.0)).is_empty());
    }

    #[test]
    fn a_threshold_rises_from_the_equator_to_the_pole() {
        let threshold = Threshold {
            equator: 1e-4,
            pole: 3e-4,
            latitude: LatitudeOf::AllViews,
        };
        assert_eq!([threshold.at(1.0), threshold.at(0.0)], [1e-4, 3e-4]);
        assert!((threshold.at(0.5) - 2e-4).abs() < 1e-9);
    }
}
