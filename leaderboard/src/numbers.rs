//! Scores and costs of results, and means of them.

use std::collections::BTreeSet;

use omnilife_schemas::records::{
    DIAGNOSIS_PREFIX, Direction, ResultRecord, StatedClock, is_of_region,
};

use crate::quantity::Quantity;

/// The default clock of times.
const WALL: &str = "wall";

/// Returns true for a warning of a suspected other convention.
pub(crate) fn is_diagnosis(warning: &str) -> bool {
    warning.starts_with(DIAGNOSIS_PREFIX)
}

/// Numbers of a set of results: a scene's repetitions, or a method's scenes.
#[derive(Debug, Clone)]
pub(crate) struct Numbers {
    /// Means in the order of [`Group::quantities`](crate::group::Group::quantities). A set of several results has none
    /// if one of them lacks it or is not complete: an average over the rest would look better than it is.
    pub(crate) scores: Vec<Option<f64>>,
    /// Means, if all results have them. A failed run has none.
    pub(crate) training_seconds: Option<f64>,
    pub(crate) peak_memory_bytes: Option<f64>,
    pub(crate) primitives: Option<f64>,
    pub(crate) iterations: Option<f64>,
    /// Views that could not be scored, in all results together.
    pub(crate) failures: usize,
    /// True if a run failed.
    pub(crate) failed: bool,
    /// True if every result is complete.
    pub(crate) complete: bool,
    /// True if a result leaves metrics of the protocol out for a quick look.
    pub(crate) partial: bool,
    /// True if a warning of a result suspects another convention.
    pub(crate) suspect: bool,
    /// Fields of results with a stated number that was not measured.
    pub(crate) stated: BTreeSet<String>,
    /// Clocks of the training times.
    clocks: BTreeSet<&'static str>,
}

impl Numbers {
    /// Returns those of one result. Without regions, scores of static and dynamic regions are
    /// missing.
    pub(crate) fn of(
        result: &ResultRecord,
        quantities: &[(Quantity, Direction)],
        without_regions: bool,
    ) -> Self {
        let score = |quantity: &Quantity| {
            if without_regions && is_of_region(&quantity.metric) {
                return None;
            }
            let scores = quantity.kind.scores(result);
            scores.get(&quantity.metric).map(|summary| summary.mean)
        };
        let run = result.run_failure.is_none().then_some(result);
        let statement = run.and_then(|run| run.statement.as_ref());
        let training_seconds = run.and_then(|run| run.training_seconds);
        let clock = match statement.and_then(|statement| statement.clock) {
            None | Some(StatedClock::Wall) => WALL,
            Some(StatedClock::Cpu) => "CPU",
            Some(StatedClock::Gpu) => "GPU",
        };
        Self {
            scores: quantities
                .iter()
                .map(|(quantity, _)| score(quantity))
                .collect(),
            training_seconds,
            peak_memory_bytes: run
                .and_then(|run| run.peak_memory_bytes)
                .map(|bytes| bytes as f64),
            primitives: run.and_then(|run| run.primitives).map(|count| count as f64),
            iterations: run.and_then(|run| run.iterations).map(|count| count as f64),
            failures: result.failures.len(),
            failed: run.is_none(),
            complete: result.is_complete(),
            partial: !result.left_out_metrics().is_empty(),
            suspect: result.warnings.iter().any(|line| is_diagnosis(line)),
            stated: statement.map_or_else(BTreeSet::new, |statement| {
                statement.numbers.iter().cloned().collect()
            }),
            clocks: training_seconds.map(|_| clock).into_iter().collect(),
        }
    }

    /// Returns arithmetic means; `parts` is not empty.
    pub(crate) fn mean(parts: &[&Self]) -> Self {
        let mean = |value: &dyn Fn(&Self) -> Option<f64>| {
            let sum: Option<f64> = parts.iter().map(|part| value(part)).sum();
            sum.map(|sum| sum / parts.len() as f64)
        };
        let complete = parts.iter().all(|part| part.complete);
        let is_shown = complete || parts.len() == 1;
        let quantities = parts.first().map_or(0, |part| part.scores.len());
        Self {
            scores: (0..quantities)
                .map(|quantity| mean(&|part| part.scores[quantity].filter(|_| is_shown)))
                .collect(),
            training_seconds: mean(&|part| part.training_seconds),
            peak_memory_bytes: mean(&|part| part.peak_memory_bytes),
            primitives: mean(&|part| part.primitives),
            iterations: mean(&|part| part.iterations),
            failures: parts.iter().map(|part| part.failures).sum(),
            failed: parts.iter().any(|part| part.failed),
            complete,
            partial: parts.iter().any(|part| part.partial),
            suspect: parts.iter().any(|part| part.suspect),
            stated: parts.iter().flat_map(|part| part.stated.clone()).collect(),
            clocks: parts.iter().flat_map(|part| part.clocks.clone()).collect(),
        }
    }

    /// Returns true if they stand for the whole protocol: others are not ranked.
    pub(crate) fn are_whole(&self) -> bool {
        self.complete && !self.partial
    }

    /// Returns the clocks of the training times in words, `CPU`; nothing if all are wall-clock times.
    pub(crate) fn clocks(&self) -> Option<String> {
        let clocks: Vec<&str> = self.clocks.iter().copied().collect();
        (clocks.iter().any(|&clock| clock != WALL)).then(|| clocks.join(" and "))
    }
}
