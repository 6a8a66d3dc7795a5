//! Settings of training.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::render::settings::RendererChoice;
use crate::schedule::Position;
use crate::{
    density::DensifySettings, model::exposure::Exposure, render::settings::RenderSettings,
};
use crate::{
    gaussians::{deformable::settings::DeformationSettings, dropout::Dropout},
    model::dynamic_settings::DynamicSettings,
    parameters::short_schedule::{LearningRate, ShortSchedule},
    step::{camera_response::ResponseSettings, pose_refinement::PoseRefinement, shards::Shards},
};

/// Resolved settings of a run, as stored in its record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// Number of optimizer steps.
    pub iterations: u64,
    /// Limit on the time in training steps, wall-clock seconds, if it ends before the iterations. Renders for
    /// the trace do not count.
    pub budget_seconds: Option<f64>,
    /// Seed of view order, split noise and other random choices.
    pub seed: u64,
    /// Weight of `1 - SSIM` against L1.
    pub ssim_weight: f32,
    /// Renderer.
    pub renderer: RendererChoice,
    /// Settings of the renderer; the degree of spherical harmonics is that at the end of their ramp.
    pub rendering: RenderSettings,
    /// Iterations after which the degree in use rises by one.
    pub sh_interval_iterations: u64,
    /// Step sizes by name of the parameter array, with their growth in short schedules.
    pub learning_rates: BTreeMap<String, LearningRate>,
    /// Larger steps for schedules shorter than the published one; `None` keeps the rates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub short_schedule: Option<ShortSchedule>,
    /// Density control.
    pub densify: DensifySettings,
    /// Settings of dynamic methods; `None` for static ones.
    #[serde(default)]
    pub dynamics: Option<DynamicSettings>,
    /// Network that deforms Gaussians; `None` for other methods.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deformation: Option<DeformationSettings>,
    /// True if Gaussians belong to objects that move along paths.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub objects: bool,
    /// Exposure gains of the views, if they are compensated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<Exposure>,
    /// Dropout of Gaussians, if used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropout: Option<Dropout>,
    /// Response of the camera, if it is learnt. Exposure gains are then where its gains begin, and images keep theirs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<ResponseSettings>,
    /// Refinement of poses, if used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_refinement: Option<PoseRefinement>,
    /// Shards that are trained one after another; `None` trains all Gaussians at once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shards: Option<Shards>,
    /// Iterations between rows of the trace; `None` for rows at equal ratios of CPU time. There is also a
    /// row before the first step and after the last.
    pub trace_every: Option<u64>,
}

impl TrainSettings {
    /// Returns the position in the schedule at `iteration` after `training_seconds` of training.
    pub fn position(&self, iteration: u64, training_seconds: f64) -> Position {
        Position::new(
            self.iterations,
            self.budget_seconds,
            iteration,
            training_seconds,
        )
    }

    /// Returns the degree of the spherical harmonics in use.
    pub fn active_sh_degree(&self, position: &Position) -> usize {
        let steps = position.scheduled / self.sh_interval_iterations.max(1);
        usize::try_from(steps)
            .unwrap_or(usize::MAX)
            .min(self.rendering.sh_degree)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::density::settings::tests::published;

    pub(crate) fn settings(budget_seconds: Option<f64>) -> TrainSettings {
        TrainSettings {
            iterations: 30_000,
            budget_seconds,
            seed: 0,
            ssim_weight: 0.2,
            renderer: RendererChoice::Exact,
            rendering: RenderSettings::new(0.2),
            sh_interval_iterations: 1_000,
            learning_rates: BTreeMap::new(),
            short_schedule: None,
            densify: published(),
            dynamics: None,
            deformation: None,
            objects: false,
            exposure: None,
            dropout: None,
            response: None,
            pose_refinement: None,
            shards: None,
            trace_every: None,
        }
    }

    #[test]
    fn a_schedule_follows_the_iterations_or_the_time_whichever_is_further() {
        let by_iterations = settings(None).position(3_000, 1e9);
        assert_eq!((by_iterations.scheduled, by_iterations.share), (3_000, 0.1));
        let by_time = settings(Some(100.0)).position(300, 50.0);
        assert_eq!((by_time.scheduled, by_time.share), (15_000, 0.5));
        // 300 iterations took half of the time: 3,000 of the schedule are 60 real ones.
        assert_eq!(by_time.real_iterations(3_000), 60);
        assert_eq!(by_iterations.real_iterations(3_000), 3_000);
    }

    #[test]
    fn the_degree_rises_by_one_every_thousand_iterations() {
        let settings = settings(None);
        let degrees = [1, 999, 1_000, 2_500, 3_000, 30_000]
            .map(|iteration| settings.active_sh_degree(&settings.position(iteration, 0.0)));
        assert_eq!(degrees, [0, 0, 1, 2, 3, 3]);
    }
}
