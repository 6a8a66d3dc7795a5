//! Schedule and thresholds of density control.

use serde::{Deserialize, Serialize};

use crate::{model::Part, schedule::Position};

/// Density control of a run. Iterations are those of the schedule; intervals of densification are real
/// iterations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DensifySettings {
    /// First iteration at which Gaussians may be added or removed.
    pub begin_iteration: u64,
    /// Last iteration at which Gaussians may be added or removed.
    pub end_iteration: u64,
    /// Iterations from one densification to the next.
    pub interval_iterations: u64,
    /// Iterations from one opacity reset to the next; 0 never resets.
    pub opacity_reset_iterations: u64,
    /// Real iterations between resets for opacities to recover; without as many, opacities are not reset.
    pub opacity_recovery_iterations: u64,
    /// Mean image-space gradient (normalized device coordinates) at which a Gaussian is cloned or split.
    pub gradient_threshold: Threshold,
    /// Unit of [`DensifySettings::clone_size`] and [`DensifySettings::prune_size`].
    pub size_unit: SizeUnit,
    /// Largest axis up to which a Gaussian is cloned, and above which it is split.
    pub clone_size: f32,
    /// Largest axis above which a Gaussian is pruned.
    pub prune_size: f32,
    /// Last iteration before Gaussians are pruned by size.
    pub prune_size_begin_iteration: u64,
    /// Opacity below which a Gaussian is pruned.
    pub prune_opacity: f32,
    /// Maximum number of Gaussians; none is added above it.
    pub maximum_gaussians: u64,
}

/// A threshold that may depend on latitude: `equator + (1 - cos lat) (pole - equator)` (ODGS
/// `scene/gaussian_model.py`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// Gradient at the equator.
    pub equator: f32,
    /// Gradient at the poles.
    pub pole: f32,
    /// Source of the latitude.
    pub latitude: LatitudeOf,
}

/// Source of the latitude on which a threshold depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LatitudeOf {
    /// The mean of `cos lat` of the Gaussian over all input views.
    AllViews,
    /// Latitude in the view rendered last, as in ODGS, although the gradients come from many views.
    LastView,
}

/// Unit of sizes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SizeUnit {
    /// The Gaussian's distance from the nearest input camera, at least the distance of neighbouring cameras.
    /// It suits scenes many times as large as the cameras' path, and long paths past near objects.
    Distance,
    /// A length in normalized units: the extent of the cameras in 3DGS, that plus 100 world units in ODGS.
    Length(f32),
}

impl Threshold {
    /// Creates a threshold that is the same at all latitudes.
    pub const fn constant(value: f32) -> Self {
        Self {
            equator: value,
            pole: value,
            latitude: LatitudeOf::AllViews,
        }
    }

    /// Returns the threshold at a cosine of the latitude.
    pub fn at(&self, cos_latitude: f32) -> f32 {
        self.equator + (1.0 - cos_latitude) * (self.pole - self.equator)
    }
}

impl DensifySettings {
    /// Returns the settings of a part: with its own unit of length, if it has one.
    pub(super) fn of_part(&self, part: &Part) -> Self {
        let unit = part.parameterization.unit_length();
        Self {
            size_unit: unit.map_or(self.size_unit, SizeUnit::Length),
            ..self.clone()
        }
    }

    /// Returns true if Gaussians are to be added and removed at this iteration.
    pub fn is_due(&self, position: &Position) -> bool {
        (self.begin_iteration..=self.end_iteration).contains(&position.scheduled)
            && position
                .iteration
                .is_multiple_of(self.interval_iterations.max(1))
    }

    /// Returns true if opacities are to be reset at this iteration; `last` is the schedule's iteration of the
    /// previous reset.
    ///
    /// Under a time budget the schedule may run too fast for opacities to recover; then they are not reset.
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

    /// Returns the schedule of 3DGS over 30,000 iterations.
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

    /// Returns the iterations of resets if each iteration takes a tenth of a second.
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
