//! A sweep's missing units as Slurm job arrays.
//!
//! Slurm queues and places; the sweep's records alone state what is done, so neither accounting nor a database is
//! needed. An array task runs `omnilife sweep run SWEEP --list FILE --line TASK`. It locks its unit, so that one that
//! was submitted twice is not done twice at a time. Some time before a job's limit Slurm signals the runner; the unit
//! writes its checkpoint, and the task goes back into the queue.

pub mod answers;
mod arrays;
mod cluster;

use std::{
    collections::BTreeSet,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use omnilife_schemas::store::{self, StoreError};

use crate::{
    error::SweepError,
    folder::{Sweep, UnitState},
    history::History,
};
pub use arrays::{JobArray, JobNeeds};

/// Folder of submissions, in a sweep's folder.
const SUBMISSIONS_FOLDER: &str = "submissions";

/// Options of a submission.
#[derive(Debug, Clone)]
pub struct SubmitRequest {
    /// The sweep's folder.
    pub folder: PathBuf,
    /// This program, at its path on the nodes.
    pub program: PathBuf,
    /// Maximum number of simultaneous tasks of all arrays together.
    pub throttle: Option<usize>,
    /// Wall-clock time of units without a measurement in their group and without a limit.
    pub unmeasured: Duration,
    /// Time before a job's end at which its unit is asked to write its checkpoint.
    pub signal_before: Duration,
    /// Further options of every `sbatch` (partition, account ...).
    pub options: Vec<String>,
    /// True to submit a job for the reduction afterwards.
    pub reduce: bool,
    /// True to submit; otherwise the arrays are only returned.
    pub submit: bool,
}

/// Submitted jobs, or planned ones.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Submission {
    /// The arrays, each with its job id if submitted.
    pub arrays: Vec<(JobArray, Option<String>)>,
    /// Units left out because an earlier submission has them in the queue.
    pub queued: usize,
    /// The job of the reduction.
    pub reduce: Option<String>,
}

/// Submits the units of a sweep that are neither done, nor failed, nor running, nor queued.
///
/// # Errors
/// When the sweep cannot be read or written, or Slurm refuses.
pub fn submit(request: &SubmitRequest) -> Result<Submission, SweepError> {
    let sweep = Sweep::open(&request.folder)?;
    let states = sweep.states()?;
    let history = History::of(sweep.plan.units.iter().zip(&states));
    let submissions = sweep.folder.join(SUBMISSIONS_FOLDER);
    let queued = queued_units(&submissions)?;
    let is_missing = |state: &UnitState| matches!(state, UnitState::Missing { .. });
    let missing: Vec<_> = (sweep.plan.units.iter().zip(&states))
        .filter_map(|(unit, state)| is_missing(state).then_some(unit))
        .collect();
    let wanted: Vec<_> = (missing.iter().copied())
        .filter(|unit| !queued.contains(&unit.id))
        .collect();
    let arrays = arrays::arrays(
        &wanted,
        &history,
        request.unmeasured.saturating_add(request.signal_before),
        cluster::max_array_size()?,
    );
    let mut submission = Submission {
        queued: missing.len() - wanted.len(),
        ..Submission::default()
    };
    if !request.submit {
        submission.arrays = arrays.into_iter().map(|array| (array, None)).collect();
        return Ok(submission);
    }
    let folder = new_folder(&submissions)?;
    let shares = arrays::throttles(&arrays, request.throttle);
    for (number, (array, throttle)) in arrays.into_iter().zip(shares).enumerate() {
        // With more arrays than tasks may run, each waits for one before it.
        let before = request.throttle.and_then(|most| number.checked_sub(most));
        let before = before.and_then(|before| submission.arrays[before].1.clone());
        let job = Job {
            request,
            sweep: &sweep,
            folder: &folder,
        };
        let id = job.array(number, &array, throttle, before.as_deref())?;
        submission.arrays.push((array, Some(id)));
    }
    if request.reduce && !submission.arrays.is_empty() {
        let job = Job {
            request,
            sweep: &sweep,
            folder: &folder,
        };
        let ids: Vec<&str> = (submission.arrays.iter())
            .filter_map(|(_, id)| id.as_deref())
            .collect();
        submission.reduce = Some(job.reduce(&ids)?);
    }
    Ok(submission)
}

/// Puts the array task of this process back into the queue, to continue later.
///
/// # Errors
/// When this is not a Slurm job, or Slurm refuses.
pub fn requeue() -> Result<String, SweepError> {
    match crate::host::runner().slurm_job {
        Some(job) => cluster::requeue(&job).map(|()| job),
        None => Err(SweepError::Slurm {
            command: "scontrol requeue".to_owned(),
            reason: "this process is not a Slurm job".to_owned(),
        }),
    }
}

/// Returns the unit at a line of a list, counted from 0.
///
/// # Errors
/// When the list cannot be read or is shorter.
pub fn unit_in_list(list: &Path, line: usize) -> Result<String, StoreError> {
    let text = fs::read_to_string(list).map_err(|source| StoreError::read(list, source))?;
    let id = text.lines().nth(line).map(str::to_owned);
    id.ok_or_else(|| StoreError::malformed(list, format!("has no line {line}")))
}

/// A submission in progress.
struct Job<'a> {
    request: &'a SubmitRequest,
    sweep: &'a Sweep,
    folder: &'a Path,
}

impl Job<'_> {
    /// Submits an array and returns its job id.
    fn array(
        &self,
        number: usize,
        array: &JobArray,
        throttle: Option<usize>,
        after: Option<&str>,
    ) -> Result<String, SweepError> {
        let list = self.folder.join(format!("array-{number}.units"));
        store::write_bytes(&list, (array.units.join("\n") + "\n").as_bytes())?;
        let mut tasks = format!("0-{}", array.units.len() - 1);
        if let Some(throttle) = throttle {
            write!(tasks, "%{throttle}").unwrap_or_default();
        }
        let needs = &array.needs;
        let mut options = vec![
            format!("--array={tasks}"),
            format!("--cpus-per-task={}", needs.cores),
            format!("--mem={}M", needs.memory_mebibytes),
            format!("--time={}", needs.minutes),
            // To the runner alone, in place of the batch shell; it asks its unit to end. The signal differs from that
            // of a cancelled job: this one comes back.
            format!("--signal=B:USR1@{}", self.request.signal_before.as_secs()),
            "--requeue".to_owned(),
            "--open-mode=append".to_owned(),
            format!("--output={}/%A_%a.out", self.folder.display()),
        ];
        if needs.gpus > 0 {
            options.push(format!("--gres=gpu:{}", needs.gpus));
        }
        options.extend(after.map(|job| format!("--dependency=afterany:{job}")));
        let script = format!(
            "exec {} --quiet sweep run {} --list {} --line \"$SLURM_ARRAY_TASK_ID\" --requeue\n",
            quoted(&self.request.program),
            quoted(&self.sweep.folder),
            quoted(&list)
        );
        let id = self.sbatch(options, &script)?;
        store::write_bytes(&list.with_extension("job"), format!("{id}\n").as_bytes())?;
        Ok(id)
    }

    /// Submits the job of the reduction for the end of the arrays, successful or not.
    fn reduce(&self, arrays: &[&str]) -> Result<String, SweepError> {
        let options = vec![
            format!("--dependency=afterany:{}", arrays.join(":")),
            format!("--output={}/reduce-%j.out", self.folder.display()),
        ];
        let script = format!(
            "exec {} --quiet sweep reduce {}\n",
            quoted(&self.request.program),
            quoted(&self.sweep.folder)
        );
        self.sbatch(options, &script)
    }

    fn sbatch(&self, options: Vec<String>, script: &str) -> Result<String, SweepError> {
        let name = self.sweep.folder.file_name().unwrap_or_default();
        let mut all = vec![
            "--parsable".to_owned(),
            format!("--job-name=omnilife-{}", name.to_string_lossy()),
            format!("--chdir={}", self.sweep.plan.folder),
        ];
        all.extend(options);
        all.extend(self.request.options.iter().cloned());
        cluster::sbatch(&all, &format!("#!/bin/sh\n{script}"))
    }
}

/// Returns a path as one word of a shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', "'\\''"))
}

/// Creates a folder for the next submission, numbered from 1.
fn new_folder(submissions: &Path) -> Result<PathBuf, StoreError> {
    store::create_folder(submissions)?;
    let names = store::names_in(submissions)?;
    let numbers = names.iter().filter_map(|name| name.parse::<u32>().ok());
    let folder = submissions.join((numbers.max().unwrap_or(0) + 1).to_string());
    store::create_folder(&folder)?;
    Ok(folder)
}

/// Returns ids of units of earlier submissions in the queue, waiting or running.
fn queued_units(submissions: &Path) -> Result<BTreeSet<String>, SweepError> {
    let mut units = BTreeSet::new();
    if !submissions.is_dir() {
        return Ok(units);
    }
    let tasks = cluster::queued_tasks()?;
    for folder in store::paths_in(submissions)? {
        for job in store::paths_in(&folder)? {
            if job.extension().is_none_or(|extension| extension != "job") {
                continue;
            }
            let read = |path: &Path| {
                fs::read_to_string(path).map_err(|source| StoreError::read(path, source))
            };
            let id = read(&job)?;
            let list = read(&job.with_extension("units"))?;
            for (line, unit) in list.lines().enumerate() {
                if tasks.contains(&format!("{}_{line}", id.trim())) {
                    units.insert(unit.to_owned());
                }
            }
        }
    }
    Ok(units)
}
