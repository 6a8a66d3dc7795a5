//! Progress of a run in its schedule, and the schedule's parameters of a step.

use crate::parameters::adam::SecondMomentDecay;

/// Progress of a run.
///
/// A schedule is written for [`crate::step::settings::TrainSettings::iterations`]. Under a time budget a run
/// may end long before; then the share of the time determines its progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Iterations done or in progress, from 1.
    pub iteration: u64,
    /// Completed share of the run, in [0, 1]; under a time budget the larger of both shares.
    pub share: f64,
    /// The iteration of the schedule that corresponds to the share.
    pub scheduled: u64,
}

impl Position {
    /// Computes the position at `iteration` after `training_seconds` of training, in a schedule of
    /// `iterations` under a budget of wall-clock seconds.
    pub fn new(
        iterations: u64,
        budget_seconds: Option<f64>,
        iteration: u64,
        training_seconds: f64,
    ) -> Self {
        let by_iterations = iteration as f64 / iterations.max(1) as f64;
        let by_time = budget_seconds.map_or(0.0, |budget| training_seconds / budget);
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
            scheduled: (share * iterations as f64) as u64,
        }
    }

    /// Returns the real iterations during which the schedule advances by `interval`.
    pub fn real_iterations(&self, interval: u64) -> u64 {
        let pace = self.iteration as f64 / self.scheduled.max(1) as f64;
        (interval as f64 * pace).round() as u64
    }
}

/// Parameters that the schedule sets for one step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepSchedule {
    /// Number of the step, from 1: Adam's bias correction depends on it.
    pub iteration: u64,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: usize,
    /// Step size of each array, in the order of [`crate::model::Model::trained_arrays`].
    pub learning_rates: Vec<f32>,
    /// Decay of the second moments of Gaussians.
    pub second_moments: SecondMomentDecay,
    /// Iteration of the schedule to which the step corresponds.
    pub scheduled: u64,
    /// Frames by which the drawn state precedes the view's time (temporal smoothing); 0 in static methods.
    pub shift_frames: f32,
}
