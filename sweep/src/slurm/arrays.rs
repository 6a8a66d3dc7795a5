//! Assignment of units to job arrays, and the resources of each array.

use std::{collections::BTreeMap, time::Duration};

use omnilife_schemas::records::SweepUnit;

use crate::history::History;

/// Margin above the longest measured time.
const TIME_MARGIN: f64 = 1.5;
/// Least requested time, minutes: nodes take a while to start and to end.
const LEAST_MINUTES: u64 = 5;
/// Memory is requested in steps, so that groups with similar needs share an array.
const MEMORY_STEP_MEBIBYTES: u64 = 256;

/// Requested resources of every task of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct JobNeeds {
    /// GPUs.
    pub gpus: u32,
    /// CPU cores.
    pub cores: u32,
    /// Memory, MiB.
    pub memory_mebibytes: u64,
    /// Wall-clock time, minutes.
    pub minutes: u64,
}

/// Units with the same requested resources.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobArray {
    /// Resources of each.
    pub needs: JobNeeds,
    /// Their ids, in the order of the plan; the first is task 0.
    pub units: Vec<String>,
}

/// Splits units into arrays of at most `most` tasks. They request the measured needs of their groups, and `unmeasured`
/// time without a measurement.
pub(super) fn arrays(
    units: &[&SweepUnit],
    history: &History,
    unmeasured: Duration,
    most: usize,
) -> Vec<JobArray> {
    let mut by_needs: BTreeMap<JobNeeds, Vec<String>> = BTreeMap::new();
    for unit in units {
        let needs = needs(unit, history, unmeasured);
        by_needs.entry(needs).or_default().push(unit.id.clone());
    }
    by_needs
        .into_iter()
        .flat_map(|(needs, units)| {
            let chunks: Vec<Vec<String>> = units.chunks(most).map(<[_]>::to_vec).collect();
            chunks
                .into_iter()
                .map(move |units| JobArray { needs, units })
        })
        .collect()
}

fn needs(unit: &SweepUnit, history: &History, unmeasured: Duration) -> JobNeeds {
    let longest = history
        .group(&unit.group)
        .filter(|cost| cost.done > 0)
        .map(|cost| cost.longest_seconds * TIME_MARGIN);
    let seconds = longest
        .or(unit.needs.limit_seconds)
        .unwrap_or(unmeasured.as_secs_f64());
    let mebibytes = history.memory_bytes(unit).div_ceil(1 << 20);
    JobNeeds {
        gpus: unit.needs.gpus,
        cores: unit.needs.cores,
        memory_mebibytes: mebibytes.next_multiple_of(MEMORY_STEP_MEBIBYTES),
        minutes: ((seconds / 60.0).ceil() as u64).max(LEAST_MINUTES),
    }
}

/// Returns how many tasks of each array may run at a time, so that all arrays together stay within `most`: in
/// proportion to their sizes, and at least one.
pub(super) fn throttles(arrays: &[JobArray], most: Option<usize>) -> Vec<Option<usize>> {
    let all: usize = arrays.iter().map(|array| array.units.len()).sum();
    let share = |array: &JobArray| most.map(|most| (most * array.units.len() / all.max(1)).max(1));
    arrays.iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::{UnitNeeds, UnitOutcome, UnitRunner};

    use super::*;

    fn unit(id: usize, group: &str, gpus: u32) -> SweepUnit {
        SweepUnit {
            id: id.to_string(),
            group: group.to_owned(),
            labels: BTreeMap::new(),
            commands: vec![vec!["true".to_owned()]],
            on_failure: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            needs: UnitNeeds {
                cores: 2,
                memory_bytes: 1 << 30,
                gpus,
                limit_seconds: None,
            },
        }
    }

    fn outcome(wall_seconds: f64, peak: u64, failure: Option<&str>) -> UnitOutcome {
        UnitOutcome {
            unit: "0".to_owned(),
            failure: failure.map(str::to_owned),
            exit_code: None,
            unit_sha256: String::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            attempt: 1,
            runner: UnitRunner {
                host: "h".to_owned(),
                process: 1,
                slurm_job: None,
            },
            begun_unix_seconds: 0.0,
            wall_seconds,
            cpu_seconds: None,
            peak_memory_bytes: Some(peak),
            log: String::new(),
            left_running: Vec::new(),
        }
    }

    #[test]
    fn units_are_chunked_by_what_they_ask_for() {
        let units: Vec<SweepUnit> = (0..2500)
            .map(|id| unit(id, "a", u32::from(id % 5 == 0)))
            .collect();
        let units: Vec<&SweepUnit> = units.iter().collect();
        let made = arrays(&units, &History::default(), Duration::from_secs(3600), 1001);
        let sizes: Vec<(u32, usize)> = made
            .iter()
            .map(|array| (array.needs.gpus, array.units.len()))
            .collect();
        assert_eq!(sizes, [(0, 1001), (0, 999), (1, 500)]);
        assert_eq!(made[0].needs.minutes, 60);
        assert_eq!(made[0].units[..3], ["1", "2", "3"]);
        let shares = throttles(&made, Some(50));
        assert_eq!(shares, [Some(20), Some(19), Some(10)]);
        assert_eq!(throttles(&made, Some(2)), [Some(1), Some(1), Some(1)]);
        assert_eq!(throttles(&made, None), [None, None, None]);
    }

    /// Time comes from completed units, memory also from those killed for it.
    #[test]
    fn needs_come_from_what_was_measured() {
        let mut history = History::default();
        history.add("a", &outcome(1000.0, 3 << 30, None));
        history.add("a", &outcome(400.0, 1 << 30, None));
        history.add("a", &outcome(9000.0, 5 << 30, Some("signal 9")));
        let unit = unit(0, "a", 0);
        let made = arrays(&[&unit], &history, Duration::from_secs(60), 10);
        assert_eq!(made[0].needs.minutes, 25);
        let memory = made[0].needs.memory_mebibytes;
        assert!((5632..5632 + 256).contains(&memory), "{memory}");
        assert!(memory.is_multiple_of(256));
    }
}
