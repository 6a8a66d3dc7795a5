//! What a training step takes.

use std::time::Instant;

use crate::{error::ReconstructError, scene::TrainingScene};
use crate::{request::BackendChoice, train::new_stepper};
use omnilife_engine::{
    model::Model,
    schedule::StepSchedule,
    step::{Stepper, settings::TrainSettings},
};

/// A model at the beginning of its training, ready for steps that move nothing.
struct Timed<'a> {
    stepper: Box<dyn Stepper + 'a>,
    schedule: StepSchedule,
    least_seconds: f64,
}

/// The least wall-clock time of some training steps on the processor for each of some models, seconds,
/// at the beginning of a run and without moving anything. The models take turns, and what else the
/// machine does only ever adds to a step's time: the least ones compare where medians do not.
///
/// # Errors
/// When a loss is not finite.
pub fn step_seconds<const N: usize>(
    scene: &TrainingScene,
    models: [(Model, &TrainSettings); N],
    rounds: usize,
) -> Result<[f64; N], ReconstructError> {
    let mut timed = Vec::with_capacity(N);
    for (model, settings) in models {
        let schedule = StepSchedule {
            iteration: 1,
            learning_rates: vec![0.0; model.shapes().len()],
            // The end of the schedule: everything takes part.
            scheduled: settings.iterations,
            ..StepSchedule::default()
        };
        timed.push(Timed {
            stepper: new_stepper(scene, model, settings, BackendChoice::Cpu)?,
            schedule,
            least_seconds: f64::INFINITY,
        });
    }
    let views = scene.input_views.len();
    // The first round fills buffers.
    for round in 0..=rounds {
        for timed in &mut timed {
            let begun = Instant::now();
            timed
                .stepper
                .step(round * views / (rounds + 1), &timed.schedule)?;
            if round > 0 {
                timed.least_seconds = timed.least_seconds.min(begun.elapsed().as_secs_f64());
            }
        }
    }
    Ok(std::array::from_fn(|index| timed[index].least_seconds))
}
