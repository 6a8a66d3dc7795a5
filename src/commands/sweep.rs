//! `omnilife sweep`.

use std::{
    collections::BTreeSet,
    env,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use anyhow::Context;
use omnilife_reconstruct::process;
use omnilife_schemas::{ErrorKind, plain_text::counted, progress::Progress, records::SweepUnit};
use omnilife_sweep::{
    PoolLimits, RunRequest, RunSummary, Sweep, SweepError, UnitState,
    history::GroupCost,
    plan, reduce, run, slurm,
    status::{self, Counts, Status},
};
use serde_json::{Value, json};

use super::curate::print_json;
use crate::{
    cli::{PlanCommand, SubmitArguments, SweepCommand, SweepRunArguments},
    exit::{self, BadRequest, PartialFailure},
    plans, termination,
};

/// Longest time that is requested for a job: a year.
const LONGEST_JOB_MINUTES: u64 = 365 * 24 * 60;

pub(crate) fn execute(command: &SweepCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        SweepCommand::Plan(command) => make_plan(command),
        SweepCommand::Run(arguments) => run_units(arguments, progress),
        SweepCommand::Status {
            sweep, csv: true, ..
        } => print_table(sweep),
        SweepCommand::Status {
            sweep, json: true, ..
        } => print_json(&status_record(&Status::of(Sweep::open(sweep)?)?)),
        SweepCommand::Status { sweep, units, .. } => print_status(sweep, *units),
        SweepCommand::Retry { sweep, units } => retry(sweep, units),
        SweepCommand::Reduce { sweep } => {
            let counts = reduce::reduce(sweep, &own_program()?, progress)?;
            exit::print(&format!("{}\n", count_words(&counts)))
        }
        SweepCommand::Submit(arguments) => submit(arguments),
    }
}

fn own_program() -> anyhow::Result<PathBuf> {
    env::current_exe().context("this program cannot be located")
}

fn make_plan(command: &PlanCommand) -> anyhow::Result<()> {
    let (out, units, reduce) = match command {
        PlanCommand::Curate {
            videos,
            dataset,
            plan,
            settings,
        } => {
            let (units, reduce) = plans::curation::units(videos, dataset, settings, plan)?;
            (&plan.out, units, vec![reduce])
        }
        PlanCommand::Bench(arguments) => {
            let (units, reduce) = plans::benchmark::sweep(arguments)?;
            (&arguments.plan.out, units, vec![reduce])
        }
        PlanCommand::Commands { file, plan, reduce } => {
            let units = plans::lines::units(file, plan)?;
            let reduce = reduce.iter().map(|line| plans::lines::shell(line));
            (&plan.out, units, reduce.collect())
        }
    };
    let here = env::current_dir().context("the working directory cannot be located")?;
    let made = plan::plan(&here, units, reduce)?;
    plan::write(out, &made)?;
    exit::print(&format!(
        "{}: {}\n",
        out.join(plan::PLAN_FILE).display(),
        counted(made.units.len(), "unit")
    ))
}

fn run_units(arguments: &SweepRunArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let only = match (&arguments.list, arguments.line) {
        (Some(list), Some(line)) => Some(BTreeSet::from([slurm::unit_in_list(list, line)?])),
        _ => None,
    };
    let limits = if only.is_some() {
        // The unit's needs were requested from the cluster's engine, which has granted them.
        PoolLimits {
            cores: u32::MAX,
            memory_bytes: u64::MAX,
            gpus: u32::MAX,
        }
    } else {
        limits(arguments)?
    };
    let request = RunRequest {
        folder: arguments.sweep.clone(),
        program: own_program()?,
        assign_gpus: only.is_none(),
        only,
        limits,
        grace: seconds(arguments.grace)?,
        wait: !arguments.no_wait,
        stop: termination::requested()?,
    };
    let summary = match run(&request, progress) {
        Err(SweepError::Interrupted) if arguments.requeue && termination::time_is_up() => {
            let job = slurm::requeue()?;
            progress.note(&format!("{job}: is back in the queue"));
            return Err(SweepError::Interrupted.into());
        }
        summary => summary?,
    };
    exit::print(&summary_words(&summary))?;
    as_result(&summary)
}

fn limits(arguments: &SweepRunArguments) -> anyhow::Result<PoolLimits> {
    let cores = match arguments.cores {
        Some(cores) => cores,
        None => u32::try_from(thread::available_parallelism()?.get())?,
    };
    let memory_bytes = match arguments.memory {
        Some(bytes) => bytes,
        None => process::available_memory_bytes().map_or(u64::MAX, |bytes| bytes / 10 * 9),
    };
    Ok(PoolLimits {
        cores,
        memory_bytes,
        gpus: arguments.gpus,
    })
}

fn seconds(value: f64) -> anyhow::Result<Duration> {
    Duration::try_from_secs_f64(value)
        .map_err(|_| BadRequest(format!("--grace must be a shorter time, got {value} s")).into())
}

fn summary_words(summary: &RunSummary) -> String {
    let mut text = format!(
        "{} done ({} here), {} failed",
        summary.done,
        summary.done_here,
        summary.failed.len()
    );
    if summary.elsewhere > 0 {
        text += &format!(", {} by others", summary.elsewhere);
    }
    text.push('\n');
    for outcome in &summary.failed {
        let reason = outcome.failure.as_deref().unwrap_or_default();
        text += &format!("failed: {}: {reason}\n", outcome.unit);
    }
    for (unit, reason) in &summary.too_big {
        text += &format!("not begun: {unit}: {reason}\n");
    }
    text
}

/// Returns an error when anything failed or was too big.
fn as_result(summary: &RunSummary) -> anyhow::Result<()> {
    let failed = summary.failed.len() + summary.too_big.len();
    let first = (summary.failed.iter())
        .map(|outcome| {
            (
                &outcome.unit,
                outcome.failure.as_deref().unwrap_or_default(),
            )
        })
        .chain(
            summary
                .too_big
                .iter()
                .map(|(unit, why)| (unit, why.as_str())),
        )
        .next();
    let Some((unit, reason)) = first else {
        return Ok(());
    };
    let all = summary.done + failed + summary.elsewhere;
    let ours = summary
        .failed
        .iter()
        .any(|outcome| outcome.exit_code != Some(2));
    Err(PartialFailure {
        message: format!(
            "{failed} of {} failed, the first: {unit}: {reason}",
            counted(all, "unit")
        ),
        blame: if ours {
            ErrorKind::Internal
        } else {
            ErrorKind::User
        },
    }
    .into())
}

fn count_words(counts: &Counts) -> String {
    let Counts {
        done,
        failed,
        running,
        missing,
    } = counts;
    format!("{done} done, {failed} failed, {running} running, {missing} missing")
}

fn print_table(folder: &Path) -> anyhow::Result<()> {
    let status = Status::of(Sweep::open(folder)?)?;
    let mut table = csv::Writer::from_writer(Vec::new());
    status.fill(&mut table)?;
    exit::print(&String::from_utf8(table.into_inner()?)?)
}

fn print_status(folder: &Path, every: bool) -> anyhow::Result<()> {
    let status = Status::of(Sweep::open(folder)?)?;
    let mut text = format!("{}\n", count_words(&status.counts()));
    for (unit, state) in status.units() {
        let reason = status::reason(state);
        if every || !reason.is_empty() {
            let reason = if reason.is_empty() {
                reason
            } else {
                format!(": {reason}")
            };
            text += &format!("{:<7} {}{reason}\n", state.name(), unit.id);
        }
    }
    let history = status.history();
    for (name, cost) in history.groups().filter(|(_, cost)| cost.done > 0) {
        let left = status
            .units()
            .filter(|(unit, state)| unit.group == name && !matches!(state, UnitState::Done(_)));
        let left: Vec<&SweepUnit> = left.map(|(unit, _)| unit).collect();
        text += &cost_words(name, cost, &left);
    }
    exit::print(&text)
}

/// Returns the status for programs; costs are sums over the units that are done.
fn status_record(status: &Status) -> Value {
    let Counts {
        done,
        failed,
        running,
        missing,
    } = status.counts();
    let history = status.history();
    let groups = history.groups().map(|(name, cost)| {
        json!({
            "group": name,
            "done": cost.done,
            "wall_seconds": cost.wall_seconds,
            "cpu_seconds": cost.cpu_seconds,
            "peak_memory_bytes": cost.peak_memory_bytes,
        })
    });
    let units = status.units().map(|(unit, state)| {
        json!({
            "unit": unit.id,
            "group": unit.group,
            "state": state.name(),
            "reason": status::reason(state),
        })
    });
    json!({
        "done": done,
        "failed": failed,
        "running": running,
        "missing": missing,
        "groups": groups.collect::<Vec<_>>(),
        "units": units.collect::<Vec<_>>(),
    })
}

/// Returns the cost of a group per unit, and the estimated cost of its remaining units.
fn cost_words(name: &str, cost: &GroupCost, left: &[&SweepUnit]) -> String {
    let done = f64::from(cost.done);
    let mean = cost.wall_seconds / done;
    let memory = cost.peak_memory_bytes.map_or_else(String::new, |bytes| {
        format!(", {:.2} GiB at most", bytes as f64 / (1_u64 << 30) as f64)
    });
    let mut text = format!(
        "{name}: {mean:.1} s and {:.1} core-seconds per unit{memory}",
        cost.cpu_seconds / done
    );
    let core_hours: f64 = left
        .iter()
        .map(|unit| mean * f64::from(unit.needs.cores) / 3600.0)
        .sum();
    if !left.is_empty() {
        text += &format!(
            "; {} left would take {core_hours:.1} core-hours",
            left.len()
        );
    }
    text.push('\n');
    text
}

fn retry(folder: &Path, ids: &[String]) -> anyhow::Result<()> {
    let sweep = Sweep::open(folder)?;
    let units: Vec<&SweepUnit> = if ids.is_empty() {
        sweep.plan.units.iter().collect()
    } else {
        ids.iter()
            .map(|id| sweep.unit(id))
            .collect::<Result<_, _>>()?
    };
    let mut count = 0;
    for unit in units {
        if sweep.retry(unit)? {
            count += 1;
        } else if !ids.is_empty() {
            return Err(BadRequest(format!("{}: has not failed", unit.id)).into());
        }
    }
    exit::print(&format!("to be done again: {}\n", counted(count, "unit")))
}

/// Returns `--minutes` and `--signal-before`, which together make the time of a job.
fn job_times(arguments: &SubmitArguments) -> anyhow::Result<[Duration; 2]> {
    let (minutes, signal_before) = (arguments.minutes, arguments.signal_before);
    if minutes > LONGEST_JOB_MINUTES || signal_before > 60 * LONGEST_JOB_MINUTES {
        let reason = format!(
            "--minutes {minutes}, --signal-before {signal_before}: a job lasts a year \
             ({LONGEST_JOB_MINUTES} minutes) at most"
        );
        return Err(BadRequest(reason).into());
    }
    Ok([
        Duration::from_secs(60 * minutes),
        Duration::from_secs(signal_before),
    ])
}

fn submit(arguments: &SubmitArguments) -> anyhow::Result<()> {
    let [unmeasured, signal_before] = job_times(arguments)?;
    let submission = slurm::submit(&slurm::SubmitRequest {
        folder: arguments.sweep.clone(),
        program: own_program()?,
        throttle: arguments.throttle.map(|most| most as usize),
        unmeasured,
        signal_before,
        options: arguments.sbatch.clone(),
        reduce: !arguments.no_reduce,
        submit: !arguments.dry_run,
    })?;
    let mut text = String::new();
    for (array, id) in &submission.arrays {
        let needs = &array.needs;
        text += &format!(
            "{}: {}, each {}, {} MiB, {} minutes",
            id.as_deref().unwrap_or("array"),
            counted(array.units.len(), "unit"),
            counted(needs.cores as usize, "core"),
            needs.memory_mebibytes,
            needs.minutes
        );
        if needs.gpus > 0 {
            text += &format!(", {} GPUs", needs.gpus);
        }
        text.push('\n');
    }
    if submission.queued > 0 {
        text += &format!(
            "in the queue already: {}\n",
            counted(submission.queued, "unit")
        );
    }
    if submission.arrays.is_empty() {
        text += "nothing to submit\n";
    }
    if let Some(id) = &submission.reduce {
        text += &format!("{id}: reduces when all is over\n");
    }
    exit::print(&text)
}
