//! Where in its schedule a run stands, and what the schedule prescribes for a step.

use crate::parameters::adam::SecondMomentDecay;

/// How far a run has come.
///
/// A schedule is written for [`crate::step::settings::TrainSettings::iterations`]. Under a time budget a run may end long
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
    /// The position at `iteration` after `training_seconds` of training, in a schedule of `iterations`
    /// under a budget of wall-clock seconds.
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

    /// Iterations that really take place while the schedule advances by `interval`.
    pub fn real_iterations(&self, interval: u64) -> u64 {
        let pace = self.iteration as f64 / self.scheduled.max(1) as f64;
        (interval as f64 * pace).round() as u64
    }
}

/// What the schedule prescribes for one step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepSchedule {
    /// Number of the step, from 1: Adam's bias correction depends on it.
    pub iteration: u64,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: usize,
    /// Step size of each array, in the order of [`crate::model::Model::trained_arrays`].
    pub learning_rates: Vec<f32>,
    /// How fast second moments of Gaussians forget.
    pub second_moments: SecondMomentDecay,
    /// The iteration of the schedule that the step stands for.
    pub scheduled: u64,
    /// How many frames before the view's moment the drawn state is (temporal smoothing); 0 in static
    /// methods.
    pub shift_frames: f32,
}
