//! Units of a benchmark or of an ablation, run by the pool of `sweep run`.
//!
//! ```text
//! OUT/sweeps/<hash of the plan>/    plan.json, units.csv, units/<id>/attempt-<n>.log
//! ```
//!
//! The same request finds the same sweep again: finished units are kept, failed ones are tried once more.

use std::{env, path::Path, thread, time::Duration};

use anyhow::Context;
use omnilife_reconstruct::process;
use omnilife_schemas::{
    ErrorKind,
    progress::Progress,
    records::{SweepUnit, UnitNeeds},
};
use omnilife_sweep::{PoolLimits, RunRequest, Sweep, UnitState, plan, reduce, run, status::Status};

use crate::{exit::PartialFailure, termination};

/// Folder of the sweeps, below the output of the command.
const SWEEPS_FOLDER: &str = "sweeps";
/// Time that units have to write their checkpoints when the command is terminated.
const GRACE: Duration = Duration::from_secs(60);
/// Memory to assume for a unit while none of its kind was measured, bytes.
const UNMEASURED_MEMORY_BYTES: u64 = 2 << 30;

/// Returns the share of the machine that a unit takes: by default all cores, one unit after another. Times of units
/// that share a machine are not comparable.
///
/// # Errors
/// When the system does not report its number of cores.
pub(super) fn needs(unit_cores: Option<u32>) -> anyhow::Result<UnitNeeds> {
    Ok(UnitNeeds {
        cores: unit_cores.unwrap_or(cores()?).max(1),
        memory_bytes: UNMEASURED_MEMORY_BYTES,
        gpus: 0,
        limit_seconds: None,
    })
}

/// Runs the units that are missing or failed earlier, lets each failure leave its record, and returns all units in
/// the order of the plan with their states.
///
/// # Errors
/// When the sweep cannot be read or written, a unit needs more than the machine has, or the command was terminated.
pub(super) fn run_units(
    out: &Path,
    units: Vec<SweepUnit>,
    progress: &dyn Progress,
) -> anyhow::Result<Vec<(SweepUnit, UnitState)>> {
    let here = env::current_dir().context("the working directory cannot be located")?;
    let program = env::current_exe().context("this program cannot be located")?;
    let made = plan::plan(&here, units, Vec::new())?;
    let folder = out.join(SWEEPS_FOLDER).join(&made.sha256[..12]);
    plan::write(&folder, &made)?;
    let sweep = Sweep::open(&folder)?;
    for unit in &sweep.plan.units {
        sweep.retry(unit)?;
    }
    let summary = run(
        &RunRequest {
            folder: folder.clone(),
            program: program.clone(),
            limits: limits(&sweep.plan.units)?,
            only: None,
            grace: GRACE,
            wait: true,
            assign_gpus: false,
            stop: termination::requested()?,
        },
        progress,
    )?;
    if let Some((unit, reason)) = summary.too_big.first() {
        return Err(PartialFailure {
            message: format!("{unit}: {reason}"),
            blame: ErrorKind::User,
        }
        .into());
    }
    reduce::reduce(&folder, &program, progress)?;
    let status = Status::of(Sweep::open(&folder)?)?;
    Ok(status
        .units()
        .map(|(unit, state)| (unit.clone(), state.clone()))
        .collect())
}

/// Returns why a unit is not done, with the kind of the error; `None` for one that is done.
pub(super) fn failure(state: &UnitState) -> Option<(String, ErrorKind)> {
    let UnitState::Failed(outcome) = state else {
        let is_done = matches!(state, UnitState::Done(_));
        return (!is_done).then(|| ("did not run".to_owned(), ErrorKind::Internal));
    };
    let blame = match outcome.exit_code {
        Some(2) => ErrorKind::User,
        _ => ErrorKind::Internal,
    };
    Some((outcome.failure.clone().unwrap_or_default(), blame))
}

fn cores() -> anyhow::Result<u32> {
    Ok(u32::try_from(thread::available_parallelism()?.get())?)
}

/// Returns all resources of the machine. Memory is reserved only where units run beside each other; a single unit may
/// use all of it.
fn limits(units: &[SweepUnit]) -> anyhow::Result<PoolLimits> {
    let cores = cores()?;
    let one_at_a_time = units.iter().all(|unit| unit.needs.cores * 2 > cores);
    let memory_bytes = match process::available_memory_bytes() {
        Some(bytes) if !one_at_a_time => bytes / 10 * 9,
        _ => u64::MAX,
    };
    Ok(PoolLimits {
        cores,
        memory_bytes,
        gpus: 0,
    })
}
