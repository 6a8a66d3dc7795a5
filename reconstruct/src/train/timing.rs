//! What a training step takes.

use std::time::Instant;

use super::{
    BackendChoice, new_stepper,
    settings::TrainSettings,
    step::{Model, StepSchedule},
};
use crate::{error::ReconstructError, scene::TrainingScene};

/// Median wall-clock time of some training steps on the processor, seconds, at the beginning of a run
/// and without moving anything.
///
/// # Errors
/// When the loss is not finite.
pub fn step_seconds(
    scene: &TrainingScene,
    model: Model,
    settings: &TrainSettings,
    steps: usize,
) -> Result<f64, ReconstructError> {
    let schedule = StepSchedule {
        iteration: 1,
        learning_rates: vec![0.0; model.shapes().len()],
        scheduled: settings.iterations,
        ..StepSchedule::default()
    };
    let mut stepper = new_stepper(scene, model, settings, BackendChoice::Cpu)?;
    let views = scene.input_views.len();
    let mut seconds = Vec::with_capacity(steps);
    // The first step fills its buffers.
    for step in 0..=steps {
        let begun = Instant::now();
        stepper.step(step * views / (steps + 1), &schedule)?;
        seconds.push(begun.elapsed().as_secs_f64());
    }
    let mut timed = seconds.split_off(1.min(steps));
    timed.sort_by(f64::total_cmp);
    Ok(timed.get(timed.len() / 2).copied().unwrap_or_default())
}
