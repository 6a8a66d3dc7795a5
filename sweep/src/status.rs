//! States of the units, for people and for tables.

use std::{collections::BTreeSet, io};

use omnilife_schemas::{
    records::{SweepUnit, UnitOutcome},
    store::{self, StoreError},
};

use crate::{
    error::SweepError,
    folder::{Sweep, UnitState},
    history::History,
};

/// The table of all units in a sweep's folder.
pub const UNITS_FILE: &str = "units.csv";

/// Number of units in each state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Done.
    pub done: usize,
    /// Failed.
    pub failed: usize,
    /// Running.
    pub running: usize,
    /// To be done.
    pub missing: usize,
}

/// Every unit with its state.
#[derive(Debug, Clone)]
pub struct Status {
    /// The sweep.
    pub sweep: Sweep,
    /// In the order of the plan.
    pub states: Vec<UnitState>,
}

impl Status {
    /// Reads the states of all units of a sweep and writes nothing.
    ///
    /// # Errors
    /// When the sweep cannot be read.
    pub fn of(sweep: Sweep) -> Result<Self, SweepError> {
        let states = sweep.states()?;
        Ok(Self { sweep, states })
    }

    /// Returns the units with their states.
    pub fn units(&self) -> impl Iterator<Item = (&SweepUnit, &UnitState)> {
        self.sweep.plan.units.iter().zip(&self.states)
    }

    /// Returns the number of units in each state.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        for state in &self.states {
            *match state {
                UnitState::Done(_) => &mut counts.done,
                UnitState::Failed(_) => &mut counts.failed,
                UnitState::Running(_) => &mut counts.running,
                UnitState::Missing { .. } => &mut counts.missing,
            } += 1;
        }
        counts
    }

    /// Returns the costs of the units so far, by group.
    pub fn history(&self) -> History {
        History::of(self.units())
    }

    /// Writes [`UNITS_FILE`], and removes leftovers of killed processes.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_csv(&self) -> Result<(), StoreError> {
        store::remove_abandoned(&self.sweep.folder)?;
        store::write_csv(&self.sweep.folder.join(UNITS_FILE), |table| {
            self.fill(table)
        })
    }

    /// Writes one row per unit with state, reason, cost and its labels; failed and missing units have a row too.
    ///
    /// # Errors
    /// When the table cannot be written.
    pub fn fill(&self, table: &mut csv::Writer<impl io::Write>) -> csv::Result<()> {
        let labels: BTreeSet<&str> = self
            .units()
            .flat_map(|(unit, _)| unit.labels.keys().map(String::as_str))
            .collect();
        table.write_record(COLUMNS.iter().chain(&labels))?;
        for (unit, state) in self.units() {
            let mut row = row(unit, state);
            let labels = labels.iter();
            row.extend(labels.map(|label| unit.labels.get(*label).cloned().unwrap_or_default()));
            table.write_record(row)?;
        }
        Ok(())
    }
}

const COLUMNS: [&str; 10] = [
    "unit",
    "group",
    "state",
    "reason",
    "attempt",
    "host",
    "slurm_job",
    "wall_seconds",
    "cpu_seconds",
    "peak_memory_bytes",
];

/// Returns why a unit failed or is missing; empty if it is done or running.
pub fn reason(state: &UnitState) -> String {
    match state {
        UnitState::Failed(outcome) => outcome.failure.clone().unwrap_or_default(),
        UnitState::Missing { reason, .. } => reason.clone().unwrap_or_default(),
        UnitState::Done(_) | UnitState::Running(_) => String::new(),
    }
}

/// Returns the line on a unit's failure: its reason, or the unit of an earlier failure with the same reason.
pub(crate) fn failure_line(outcome: &UnitOutcome, earlier: &[UnitOutcome]) -> String {
    let same = earlier
        .iter()
        .find(|other| other.failure == outcome.failure);
    match same {
        Some(first) => format!("{}: fails as {} does", outcome.unit, first.unit),
        None => {
            let reason = outcome.failure.as_deref().unwrap_or_default();
            format!("{}: {reason}", outcome.unit)
        }
    }
}

fn row(unit: &SweepUnit, state: &UnitState) -> Vec<String> {
    let seconds = |value: f64| format!("{value:.3}");
    let text = |value: Option<String>| value.unwrap_or_default();
    let outcome: Option<&UnitOutcome> = match state {
        UnitState::Done(outcome) | UnitState::Failed(outcome) => Some(outcome),
        UnitState::Running(_) | UnitState::Missing { .. } => None,
    };
    let runner = match state {
        UnitState::Running(runner) => Some(runner.as_ref()),
        _ => outcome.map(|outcome| &outcome.runner),
    };
    vec![
        unit.id.clone(),
        unit.group.clone(),
        state.name().to_owned(),
        reason(state),
        text(outcome.map(|outcome| outcome.attempt.to_string())),
        text(runner.map(|runner| runner.host.clone())),
        text(runner.and_then(|runner| runner.slurm_job.clone())),
        text(outcome.map(|outcome| seconds(outcome.wall_seconds))),
        text(outcome.and_then(|outcome| outcome.cpu_seconds.map(seconds))),
        text(outcome.and_then(|outcome| Some(outcome.peak_memory_bytes?.to_string()))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lock;

    #[test]
    fn a_reason_is_printed_with_the_first_unit_that_has_it() {
        let failed = |unit: &str, failure: &str| UnitOutcome {
            unit: unit.to_owned(),
            failure: Some(failure.to_owned()),
            exit_code: Some(2),
            unit_sha256: String::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            attempt: 1,
            runner: lock::unknown(),
            begun_unix_seconds: 0.0,
            wall_seconds: 0.0,
            cpu_seconds: None,
            peak_memory_bytes: None,
            log: String::new(),
            left_running: Vec::new(),
        };
        let earlier = [failed("a", "no frame 3"), failed("b", "no memory")];
        let line = |unit: &str, failure: &str| failure_line(&failed(unit, failure), &earlier);
        assert_eq!(line("c", "no weights"), "c: no weights");
        let repeated = line("d", "no memory");
        assert!(repeated.contains('b') && !repeated.contains("no memory"));
    }
}
