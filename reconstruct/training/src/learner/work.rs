//! Work of a training step, in counts that do not depend on the machine.

use omnilife_engine::step::settings::TrainSettings;

use crate::scene::TrainingScene;

/// Mean work of the steps of a schedule, with the first Gaussians.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepWork {
    /// Number of trained values.
    pub values: u64,
    /// Mean number of pixels that a step draws and compares with an image.
    pub pixels: f64,
    /// Maximum number of Gaussians.
    pub most_gaussians: u64,
    /// Parts that not every step has, with the share of those that do, 0 to 1.
    pub parts: Vec<(&'static str, f64)>,
}

impl StepWork {
    /// Counts the work under settings on a scene.
    pub(super) fn of(scene: &TrainingScene, settings: &TrainSettings, values: u64) -> Self {
        let views = &scene.input_views;
        let masked = views.iter().filter(|view| view.mask.is_some()).count();
        let masked = masked as f64 / views.len().max(1) as f64;
        let from = |begin: u64| 1.0 - (begin as f64 / settings.iterations.max(1) as f64).min(1.0);
        let dynamics = settings.dynamics.as_ref();
        let alone = dynamics.and_then(|dynamics| dynamics.dynamic_loss);
        let alone = alone.map(|loss| masked * from(loss.begin_iteration));
        let moved = dynamics.and_then(|dynamics| dynamics.smoothing);
        let velocities = dynamics.and_then(|dynamics| dynamics.velocity_loss);
        let parts = [
            ("moving Gaussians drawn alone", alone),
            (
                "another moment drawn",
                moved.map(|smoothing| smoothing.probability),
            ),
            (
                "velocities compared",
                velocities.map(|loss| if loss.outside_masks { masked } else { 1.0 }),
            ),
            (
                "poses moved",
                settings
                    .pose_refinement
                    .as_ref()
                    .map(|poses| from(poses.begin_iteration)),
            ),
        ];
        let [width, height] = scene.inputs().size();
        Self {
            values,
            pixels: (width * height) as f64 * (1.0 + alone.unwrap_or(0.0)),
            most_gaussians: settings.densify.maximum_gaussians,
            parts: parts
                .into_iter()
                .filter_map(|(name, share)| Some((name, share?)))
                .collect(),
        }
    }
}
