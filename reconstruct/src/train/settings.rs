//! Everything the training loop needs to know, and where in its schedule a run stands.

use std::collections::BTreeMap;

use omnilife_schemas::RgbImage;
use serde::{Deserialize, Serialize};

use super::{
    deformation_settings::DeformationSettings, dynamic_settings::DynamicSettings,
    pose_refinement::PoseRefinement,
};
use crate::{densify::DensifySettings, exposure::Exposure, optim::Decay, render::RenderSettings};

/// Settings of a run as resolved; they stand in its record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// Steps of the optimizer.
    pub iterations: u64,
    /// Stops after this time in training steps, seconds of wall clock, whatever the iterations; what
    /// the trace renders does not count.
    pub budget_seconds: Option<f64>,
    /// Seed of view order and split noise.
    pub seed: u64,
    /// Weight of `1 - SSIM` against L1.
    pub ssim_weight: f32,
    /// Which renderer makes images from Gaussians.
    pub renderer: RendererChoice,
    /// How it does; its degree of spherical harmonics is that at the end of
    /// their ramp.
    pub rendering: RenderSettings,
    /// Iterations after which the degree in use rises by one.
    pub sh_interval_iterations: u64,
    /// Step sizes by name of the parameter array.
    pub learning_rates: BTreeMap<String, Decay>,
    /// Density control.
    pub densify: DensifySettings,
    /// What is known of time; static methods have none of it.
    #[serde(default)]
    pub dynamics: Option<DynamicSettings>,
    /// A network that deforms Gaussians; other methods have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deformation: Option<DeformationSettings>,
    /// Gains of the views, where they are compensated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<Exposure>,
    /// When poses are refined, where they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_refinement: Option<PoseRefinement>,
    /// Iterations from one row of the trace to the next; the last iteration has a row too.
    pub trace_every: u64,
}

/// Which renderer makes images from Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererChoice {
    /// [`crate::render`].
    Exact,
    /// [`crate::kernels::odgs_published`], defects included.
    OdgsPublished,
}

/// How far a run has come.
///
/// A schedule is written for [`TrainSettings::iterations`]. Under a time budget a run may end long
/// before them: then it is the share of the time that says how far it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Iterations done or in progress, from 1.
    pub iteration: u64,
    /// Share of the run that is over, in [0, 1]; under a time budget the larger of both shares.
    pub share: f64,
    /// The iteration of the schedule that corresponds to the share.
    pub scheduled: u64,
}

impl Position {
    /// The position at `iteration` after `training_seconds` of training.
    pub fn new(settings: &TrainSettings, iteration: u64, training_seconds: f64) -> Self {
        let by_iterations = iteration as f64 / settings.iterations.max(1) as f64;
        let by_time = settings
            .budget_seconds
            .map_or(0.0, |budget| training_seconds / budget);
        if by_time <= by_iterations {
            return Self {
                iteration,
                share: by_iterations.min(1.0),
                scheduled: iteration,
            };
        }
        let share = by_time.min(1.0);
        Self {
            iteration,
            share,
            scheduled: (share * settings.iterations as f64) as u64,
        }
    }

    /// Iterations that really take place while the schedule advances by `interval`.
    pub fn real_iterations(&self, interval: u64) -> u64 {
        let pace = self.iteration as f64 / self.scheduled.max(1) as f64;
        (interval as f64 * pace).round() as u64
    }
}

impl TrainSettings {
    /// Puts the gain of a view's time onto its render, where gains are compensated.
    pub fn expose(&self, image: &mut RgbImage, seconds: f64) {
        if let Some(exposure) = &self.exposure {
            exposure.apply(&mut image.data, seconds);
        }
    }

    /// Degree of the spherical harmonics in use.
    pub fn active_sh_degree(&self, position: &Position) -> usize {
        let steps = position.scheduled / self.sh_interval_iterations.max(1);
        usize::try_from(steps)
            .unwrap_or(usize::MAX)
            .min(self.rendering.sh_degree)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::odgs;

    fn settings(budget_seconds: Option<f64>) -> TrainSettings {
        let published = odgs::published_settings(30_000);
        TrainSettings {
            budget_seconds,
            rendering: RenderSettings {
                sh_degree: 3,
                ..published.rendering
            },
            ..published
        }
    }

    #[test]
    fn a_schedule_follows_the_iterations_or_the_time_whichever_is_further() {
        let by_iterations = Position::new(&settings(None), 3_000, 1e9);
        assert_eq!((by_iterations.scheduled, by_iterations.share), (3_000, 0.1));
        let by_time = Position::new(&settings(Some(100.0)), 300, 50.0);
        assert_eq!((by_time.scheduled, by_time.share), (15_000, 0.5));
        // 300 iterations took half of the time: 3,000 of the schedule are 60 real ones.
        assert_eq!(by_time.real_iterations(3_000), 60);
        assert_eq!(by_iterations.real_iterations(3_000), 3_000);
    }

    #[test]
    fn the_degree_rises_by_one_every_thousand_iterations() {
        let settings = settings(None);
        let degrees = [1, 999, 1_000, 2_500, 3_000, 30_000]
            .map(|iteration| settings.active_sh_degree(&Position::new(&settings, iteration, 0.0)));
        assert_eq!(degrees, [0, 0, 1, 2, 3, 3]);
    }
}
