//! Measured costs of units, by group: an estimate for others of the group.

use std::collections::BTreeMap;

use omnilife_schemas::records::{SweepUnit, UnitOutcome};

use crate::folder::UnitState;

/// Margin above the highest measured memory: units of a group differ a little.
const MEMORY_MARGIN: f64 = 1.1;

/// Costs of the units of one group.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GroupCost {
    /// Units that are done.
    pub done: u32,
    /// Their wall-clock time together, seconds.
    pub wall_seconds: f64,
    /// The longest of them, seconds.
    pub longest_seconds: f64,
    /// Their CPU time, seconds, if the system reports it.
    pub cpu_seconds: f64,
    /// Highest resident memory of any, failed ones included, bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// The costs of all groups.
#[derive(Debug, Clone, Default)]
pub struct History {
    groups: BTreeMap<String, GroupCost>,
}

impl History {
    /// Collects the costs of a plan's units so far.
    pub fn of<'a>(units: impl Iterator<Item = (&'a SweepUnit, &'a UnitState)>) -> Self {
        let mut history = Self::default();
        for (unit, state) in units {
            if let UnitState::Done(outcome) | UnitState::Failed(outcome) = state {
                history.add(&unit.group, outcome);
            }
        }
        history
    }

    /// Adds the costs of one unit.
    pub fn add(&mut self, group: &str, outcome: &UnitOutcome) {
        let cost = self.groups.entry(group.to_owned()).or_default();
        cost.peak_memory_bytes = cost.peak_memory_bytes.max(outcome.peak_memory_bytes);
        if outcome.failure.is_none() {
            cost.done += 1;
            cost.wall_seconds += outcome.wall_seconds;
            cost.longest_seconds = cost.longest_seconds.max(outcome.wall_seconds);
            cost.cpu_seconds += outcome.cpu_seconds.unwrap_or(0.0);
        }
    }

    /// Returns every group with costs.
    pub fn groups(&self) -> impl Iterator<Item = (&str, &GroupCost)> {
        self.groups.iter().map(|(name, cost)| (name.as_str(), cost))
    }

    /// Returns the costs of a group's units; `None` if none has ended.
    pub fn group(&self, name: &str) -> Option<&GroupCost> {
        self.groups.get(name)
    }

    /// Returns the memory to reserve for a unit, bytes: the measured need of its group, with a margin, or the planned
    /// one.
    pub fn memory_bytes(&self, unit: &SweepUnit) -> u64 {
        self.measured_memory_bytes(unit)
            .map_or(unit.needs.memory_bytes, |peak| {
                (peak as f64 * MEMORY_MARGIN) as u64
            })
    }

    /// Returns the measured memory of a unit's group, without a margin.
    pub fn measured_memory_bytes(&self, unit: &SweepUnit) -> Option<u64> {
        self.groups.get(&unit.group)?.peak_memory_bytes
    }
}
