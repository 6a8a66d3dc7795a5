//! Reduction of the units' results to one whole: tables, a dataset.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{plain_text, progress::Progress};

use crate::{
    error::SweepError,
    folder::{Sweep, UnitState},
    process::{self, Job, Running},
    status::{self, Counts, Status},
};

/// All output of the reduction, in the sweep's folder.
const LOG_FILE: &str = "reduce.log";

/// Writes the table of units, leaves a record of every failure, and runs the plan's reduction.
///
/// # Errors
/// When the sweep cannot be read or written, or a command of the reduction fails. Failed units are not errors, nor is a
/// unit whose failure cannot be recorded, such as one without a split: it is noted, once for units of one reason.
pub fn reduce(
    folder: &Path,
    program: &Path,
    progress: &dyn Progress,
) -> Result<Counts, SweepError> {
    let status = Status::of(Sweep::open(folder)?)?;
    status.write_csv()?;
    let log = status.sweep.folder.join(LOG_FILE);
    omnilife_schemas::store::remove(&log)?;
    let mut unrecorded: BTreeMap<String, (String, usize)> = BTreeMap::new();
    for (unit, state) in status.units() {
        if matches!(state, UnitState::Failed(_)) {
            let reason = status::reason(state);
            for command in &unit.on_failure {
                let filled: Vec<String> = command
                    .iter()
                    .map(|word| word.replace("{reason}", &reason))
                    .collect();
                if let Err(error) = run(&status.sweep, &filled, program, &log, progress) {
                    let first = || (format!("{}: {reason}; {error}", unit.id), 0);
                    unrecorded.entry(reason.clone()).or_insert_with(first).1 += 1;
                    break;
                }
            }
        }
    }
    for (first, units) in unrecorded.values() {
        progress.note(&match units {
            1 => first.clone(),
            _ => format!("{first} (the first of {units} units that failed for this reason)"),
        });
    }
    let stale: Vec<String> = (status.units())
        .filter(|(unit, state)| {
            let has_changed = matches!(state, UnitState::Missing { reason: Some(_) });
            has_changed && status.sweep.outputs(unit).is_ok()
        })
        .map(|(unit, state)| format!("{}: {}", unit.id, status::reason(state)))
        .collect();
    if !stale.is_empty() {
        progress.note(&format!(
            "results of units that have to be done again are reduced as they are: {} ({})",
            stale.len(),
            plain_text::first_of(&stale)
        ));
    }
    for command in &status.sweep.plan.reduce {
        progress.note(&format!("reducing: {}", command.join(" ")));
        run(&status.sweep, command, program, &log, progress)?;
    }
    Ok(status.counts())
}

fn run(
    sweep: &Sweep,
    command: &[String],
    program: &Path,
    log: &Path,
    progress: &dyn Progress,
) -> Result<(), SweepError> {
    let job = Job {
        command,
        program,
        folder: Path::new(&sweep.plan.folder),
        variables: &[],
        log,
        lock: None,
    };
    let reason = match process::run(&job, &Running::default()) {
        Ok(ended) => {
            for what in &ended.left_running {
                progress.note(&format!("{}: left running: {what}", command.join(" ")));
            }
            if ended.succeeded {
                return Ok(());
            }
            ended.in_words()
        }
        Err(error) => error.to_string(),
    };
    Err(SweepError::Reduce {
        command: command.join(" "),
        reason,
    })
}
