//! One locked unit, from its first command to its outcome.

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use omnilife_schemas::{
    child::Outcome,
    records::{SweepUnit, UnitInput, UnitOutcome},
    stage::StageOutput,
    store::{self, StoreError},
};

use crate::{
    folder::Sweep,
    host,
    lock::HeldLock,
    plan,
    process::{self, EndReason, Job, Running},
};

/// Number of lost runners after which a unit has failed.
pub(crate) const MOST_LOST_RUNNERS: u32 = 3;
/// Exit code of a command that was asked to end and resumes when started again: `EX_TEMPFAIL` of sysexits.h.
const INTERRUPTED: i32 = 75;

pub(crate) enum AttemptEnd {
    /// Done or failed, with its outcome.
    Over(Box<UnitOutcome>),
    /// The runner was asked to end; the unit is missing again.
    Interrupted,
}

/// Environment of a unit's commands.
pub(crate) struct Launch<'a> {
    /// This program, under the name `omnilife` in them.
    pub(crate) program: &'a Path,
    /// Variables set beside those of this process.
    pub(crate) variables: Vec<(String, String)>,
}

/// Runs a unit whose folder is locked, writes its outcome and releases the lock. `idle` is called when the commands
/// have ended: the rest takes no core, but waits for the disk.
///
/// # Errors
/// When a file of the sweep cannot be written. A failed unit is an outcome.
pub(crate) fn run(
    sweep: &Sweep,
    unit: &SweepUnit,
    lock: &HeldLock,
    launch: Launch<'_>,
    running: &Running,
    stop: &AtomicBool,
    idle: impl FnOnce(),
) -> Result<AttemptEnd, StoreError> {
    let attempt = Attempt::begin(sweep, unit)?;
    let mut cost = Cost::default();
    let result = attempt.work(&launch, lock, running, &mut cost);
    if let Err(failure) = &result
        && failure.may_be_interruption
    {
        wait_for_own_signal(running, stop);
    }
    // A unit that ended well in spite of it is done.
    if running.reason() == Some(EndReason::Stop) && result.is_err() {
        lock.file.release()?;
        return Ok(AttemptEnd::Interrupted);
    }
    idle();
    let outcome = attempt.outcome(result, &cost);
    sweep.write_outcome(unit, &outcome)?;
    lock.file.release()?;
    Ok(AttemptEnd::Over(Box::new(outcome)))
}

/// Waits for a signal to this process. A cluster's engine signals all processes of a job at about the same time. If the
/// signal that ended the unit is about to arrive here, the unit has not failed.
fn wait_for_own_signal(running: &Running, stop: &AtomicBool) {
    const LONGEST: Duration = Duration::from_millis(500);
    let begun = Instant::now();
    while running.reason().is_none() && begun.elapsed() < LONGEST {
        if stop.load(Ordering::Relaxed) {
            running.end(EndReason::Stop);
        } else {
            thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Writes the failure of a unit that has lost too many runners.
///
/// # Errors
/// When a file of the sweep cannot be written.
pub(crate) fn give_up(
    sweep: &Sweep,
    unit: &SweepUnit,
    lock: &HeldLock,
    last: &str,
) -> Result<UnitOutcome, StoreError> {
    let attempt = Attempt::begin(sweep, unit)?;
    let reason = format!("given up after {MOST_LOST_RUNNERS} runners: {last}");
    let outcome = attempt.outcome(Err(Failure::of(reason)), &Cost::default());
    sweep.write_outcome(unit, &outcome)?;
    lock.file.release()?;
    Ok(outcome)
}

#[derive(Default)]
struct Cost {
    cpu_seconds: Option<f64>,
    peak_memory_bytes: Option<u64>,
    left_running: Vec<String>,
}

struct Failure {
    reason: String,
    exit_code: Option<i32>,
    /// True if it may have been asked to end by an unknown process.
    may_be_interruption: bool,
    inputs: Vec<UnitInput>,
}

impl Failure {
    fn of(reason: String) -> Self {
        Self {
            reason,
            exit_code: None,
            may_be_interruption: false,
            inputs: Vec::new(),
        }
    }
}

type WorkResult = Result<(Vec<UnitInput>, Vec<StageOutput>), Failure>;

struct Attempt<'a> {
    sweep: &'a Sweep,
    unit: &'a SweepUnit,
    number: u32,
    log: String,
    begun: Instant,
    begun_unix_seconds: f64,
}

impl<'a> Attempt<'a> {
    fn begin(sweep: &'a Sweep, unit: &'a SweepUnit) -> Result<Self, StoreError> {
        let logs = store::names_in(&sweep.unit_folder(unit))?;
        let numbers = logs.iter().filter_map(|name| {
            let number = name.strip_prefix("attempt-")?.strip_suffix(".log")?;
            number.parse::<u32>().ok()
        });
        let number = numbers.max().unwrap_or(0) + 1;
        Ok(Self {
            sweep,
            unit,
            number,
            log: format!("attempt-{number}.log"),
            begun: Instant::now(),
            begun_unix_seconds: host::unix_seconds(),
        })
    }

    fn work(
        &self,
        launch: &Launch<'_>,
        lock: &HeldLock,
        running: &Running,
        cost: &mut Cost,
    ) -> WorkResult {
        let log = self.sweep.unit_folder(self.unit).join(&self.log);
        let inputs = match self.sweep.inputs(self.unit) {
            Ok(inputs) => inputs,
            Err(error) => {
                return Err(Failure {
                    // A faulty input is the user's error.
                    exit_code: Some(2),
                    ..Failure::of(error.to_string())
                });
            }
        };
        for command in &self.unit.commands {
            let job = Job {
                command,
                program: launch.program,
                folder: Path::new(&self.sweep.plan.folder),
                variables: &launch.variables,
                log: &log,
                lock: Some(lock.file.file()),
            };
            let ended = match process::run(&job, running) {
                Ok(ended) => ended,
                Err(error) => return Err(Failure::of(error.to_string())),
            };
            if let Some(seconds) = ended.cpu_seconds {
                *cost.cpu_seconds.get_or_insert(0.0) += seconds;
            }
            cost.peak_memory_bytes = cost.peak_memory_bytes.max(ended.peak_memory_bytes);
            cost.left_running.extend(ended.left_running.iter().cloned());
            if !ended.succeeded {
                return Err(Failure {
                    reason: self.reason(command, &ended, running),
                    exit_code: ended.exit_code,
                    // A signal, or the exit code after writing a checkpoint.
                    may_be_interruption: matches!(ended.exit_code, None | Some(INTERRUPTED)),
                    inputs,
                });
            }
        }
        match self.sweep.outputs(self.unit) {
            Ok(outputs) => Ok((inputs, outputs)),
            Err(reason) => Err(Failure {
                inputs,
                ..Failure::of(reason)
            }),
        }
    }

    fn reason(&self, command: &[String], ended: &Outcome, running: &Running) -> String {
        if running.reason() == Some(EndReason::Limit) {
            let limit = self.unit.needs.limit_seconds.unwrap_or_default();
            return format!("ended at its time limit of {limit} s");
        }
        // The program and its subcommands, without files and options.
        let is_word = |word: &&String| !word.starts_with('-') && !word.contains(['/', '.']);
        let program = Path::new(&command[0]).file_name().unwrap_or_default();
        let words = command[1..].iter().take_while(is_word).take(2).cloned();
        let mut name = vec![program.to_string_lossy().into_owned()];
        name.extend(words);
        format!("{}: {}", name.join(" "), ended.in_words())
    }

    fn outcome(&self, result: WorkResult, cost: &Cost) -> UnitOutcome {
        let (failure, exit_code, inputs, outputs) = match result {
            Ok((inputs, outputs)) => (None, None, inputs, outputs),
            Err(failure) => (
                Some(failure.reason),
                failure.exit_code,
                failure.inputs,
                Vec::new(),
            ),
        };
        UnitOutcome {
            unit: self.unit.id.clone(),
            failure,
            exit_code,
            unit_sha256: plan::unit_hash(self.unit),
            inputs,
            outputs,
            attempt: self.number,
            runner: host::runner(),
            begun_unix_seconds: self.begun_unix_seconds,
            wall_seconds: self.begun.elapsed().as_secs_f64(),
            cpu_seconds: cost.cpu_seconds,
            peak_memory_bytes: cost.peak_memory_bytes,
            log: self.log.clone(),
            left_running: cost.left_running.clone(),
        }
    }
}
