//! What units have cost, by group: what others of the group will need.

use std::collections::BTreeMap;

use omnilife_schemas::records::{SweepUnit, UnitOutcome};

use crate::folder::UnitState;

/// Room above the highest memory measured: units of a group differ a little.
const MEMORY_MARGIN: f64 = 1.1;

/// What the units of one group have cost.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GroupCost {
    /// Units that are done.
    pub done: u32,
    /// Their wall-clock time together, seconds.
    pub wall_seconds: f64,
    /// The longest of them, seconds.
    pub longest_seconds: f64,
    /// Their CPU time, seconds, where the system tells.
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
    /// What the units of a plan have cost so far.
    pub fn of<'a>(units: impl Iterator<Item = (&'a SweepUnit, &'a UnitState)>) -> Self {
        let mut history = Self::default();
        for (unit, state) in units {
            if let UnitState::Done(outcome) | UnitState::Failed(outcome) = state {
                history.add(&unit.group, outcome);
            }
        }
        history
    }

    /// Adds what one unit has cost.
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

    /// Every group that has cost something.
    pub fn groups(&self) -> impl Iterator<Item = (&str, &GroupCost)> {
        self.groups.iter().map(|(name, cost)| (name.as_str(), cost))
    }

    /// What the units of a group have cost; `None` where none has ended.
    pub fn group(&self, name: &str) -> Option<&GroupCost> {
        self.groups.get(name)
    }

    /// The memory to set aside for a unit, bytes: what its group was measured to need, with room
    /// above, or what it was planned with.
    pub fn memory_bytes(&self, unit: &SweepUnit) -> u64 {
        self.measured_memory_bytes(unit)
            .map_or(unit.needs.memory_bytes, |peak| {
                (peak as f64 * MEMORY_MARGIN) as u64
            })
    }

    /// The memory that a unit's group was measured to need, without room above.
    pub fn measured_memory_bytes(&self, unit: &SweepUnit) -> Option<u64> {
        self.groups.get(&unit.group)?.peak_memory_bytes
    }
}
