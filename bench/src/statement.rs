//! Facts about a run that are stated when scoring, because no record of the run has them.

use std::path::Path;

use omnilife_schemas::{
    names,
    records::{ResultRecord, RunStatement, StatedClock, TrainingKind},
};

use crate::{error::BenchError, run_facts::RunFacts};

/// Checks the name of a method, by which its results are one row of the tables.
///
/// # Errors
/// When it is empty, of several lines, or has spaces around it.
pub(crate) fn check_method(name: &str) -> Result<(), BenchError> {
    let reason = if name.trim().is_empty() {
        "the method must have a name, for the tables".to_owned()
    } else if names::is_plain(name) {
        return Ok(());
    } else {
        format!(
            "the name of the method must be of one line, without spaces around it, got {name:?}"
        )
    };
    Err(BenchError::Statement { reason })
}

/// Facts stated beside predictions. All are optional.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Statement {
    /// Kind of training of the method.
    pub training: Option<TrainingKind>,
    /// Training time, seconds, finite and not negative.
    pub training_seconds: Option<f64>,
    /// The clock of that time; wall-clock time if not stated.
    pub clock: Option<StatedClock>,
    /// Optimizer steps.
    pub iterations: Option<u64>,
    /// Number of Gaussians, or of other primitives of the model.
    pub primitives: Option<u64>,
    /// Random seed.
    pub seed: Option<u64>,
    /// Processors, GPUs and memory of the run.
    pub hardware: Option<String>,
    /// Address of the method's code.
    pub code: Option<String>,
}

impl Statement {
    /// Checks that the numbers are possible, and that no stated fact is measured in the record of the run, in `file`.
    ///
    /// # Errors
    /// When a time is negative or not finite, a clock is stated without a time, or the record has the fact.
    pub(crate) fn check(&self, run: Option<(&Path, &RunFacts)>) -> Result<(), BenchError> {
        if let Some(seconds) = self.training_seconds
            && !(seconds.is_finite() && seconds >= 0.0)
        {
            let reason =
                format!("a training time must be finite and not negative, got {seconds} s");
            return Err(BenchError::Statement { reason });
        }
        if self.clock.is_some() && self.training_seconds.is_none() {
            let reason = "a clock is of a training time, and none is stated".to_owned();
            return Err(BenchError::Statement { reason });
        }
        let Some((file, run)) = run else {
            return Ok(());
        };
        let both = [
            (
                "training time",
                self.training_seconds.is_some() && run.training_seconds.is_some(),
            ),
            (
                "iterations",
                self.iterations.is_some() && run.iterations.is_some(),
            ),
            (
                "primitives",
                self.primitives.is_some() && run.primitives.is_some(),
            ),
            ("seed", self.seed.is_some()),
        ];
        match both.iter().find(|(_, is_both)| *is_both) {
            Some((fact, _)) => {
                let reason = format!("has the {fact} of the run: state only facts that it lacks");
                Err(BenchError::mismatch(file, reason))
            }
            None => Ok(()),
        }
    }

    /// Puts the facts into a result, with the names of its fields that hold a stated number.
    pub(crate) fn apply(&self, result: &mut ResultRecord) {
        // A failed run has no time, whatever is stated.
        let training_seconds = self
            .training_seconds
            .filter(|_| result.run_failure.is_none());
        let mut numbers = Vec::new();
        let mut fill = |name: &str, is_stated: bool| {
            if is_stated {
                numbers.push(name.to_owned());
            }
        };
        fill("iterations", state(&mut result.iterations, self.iterations));
        fill("primitives", state(&mut result.primitives, self.primitives));
        fill("seed", state(&mut result.seed, self.seed));
        fill(
            "training_seconds",
            state(&mut result.training_seconds, training_seconds),
        );
        if self.training.is_some() {
            result.training = self.training;
        }
        if *self != Self::default() {
            result.statement = Some(RunStatement {
                numbers,
                clock: self
                    .clock
                    .or_else(|| training_seconds.map(|_| StatedClock::Wall)),
                hardware: self.hardware.clone(),
                code: self.code.clone(),
            });
        }
    }
}

/// Fills an empty field; returns true if it was filled.
fn state<T: Copy>(field: &mut Option<T>, stated: Option<T>) -> bool {
    if field.is_some() || stated.is_none() {
        return false;
    }
    *field = stated;
    true
}
