//! One command of somebody else's program, run to its end or its time limit, and what it cost.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::{
    process,
    process_group::{Container, Leftovers, ProcessGroup},
    store::StoreError,
};

/// What to run.
#[derive(Debug)]
pub struct Job {
    /// Program and arguments.
    pub command: Vec<String>,
    /// Variables set beside those of this process.
    pub variables: BTreeMap<String, String>,
    /// Working directory.
    pub folder: PathBuf,
    /// File for everything it prints.
    pub log: PathBuf,
    /// After this long it is ended, with everything that it started.
    pub time_limit: Option<Duration>,
    /// Time that it has to put things in order before it is killed.
    pub grace: Duration,
    /// The container that it runs, where it is the client of a runtime.
    pub container: Option<Container>,
}

/// How it went.
#[derive(Debug)]
pub struct Outcome {
    /// Program and arguments.
    pub command: Vec<String>,
    /// Whether it ended by itself, and with success.
    pub succeeded: bool,
    /// In words.
    pub ending: String,
    /// The last line that it had printed then, where it had printed any.
    pub last_line: Option<String>,
    /// Processes and containers that ran on when it had ended, or did not end when they were told to at a
    /// limit, in words. All have been ended but for those that say that they could not be; the command
    /// has failed then.
    pub left_running: Vec<String>,
    /// Wall-clock time until its end or its limit, seconds.
    pub wall_seconds: f64,
    /// CPU time, seconds, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Highest resident memory, bytes, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

impl Outcome {
    /// How it ended and the last line that it printed, in words.
    pub fn failure(&self) -> String {
        let line = self.last_line.iter();
        let line: String = line.map(|line| format!(": {line}")).collect();
        format!("ended with {}{line}", self.ending)
    }
}

/// How often a running command is looked at. Its end is seen this late, which is added to its
/// time at most once.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// A command that prints more than this is ended: it would fill the disk.
const MOST_LOG_BYTES: u64 = 4 << 30;

/// Runs a command with no standard input and both outputs in the log.
///
/// # Errors
/// When the log cannot be written. A command that cannot be started is an outcome.
pub fn run(job: &Job) -> Result<Outcome, StoreError> {
    let unwritable = |source| StoreError::write(&job.log, source);
    let log = File::create(&job.log).map_err(unwritable)?;
    let errors = log.try_clone().map_err(unwritable)?;
    let before = Usage::of_children();
    let begun = Instant::now();
    let mut command = Command::new(&job.command[0]);
    command
        .args(&job.command[1..])
        .envs(&job.variables)
        .current_dir(&job.folder)
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(errors);
    let ending = match ProcessGroup::spawn(&mut command, job.container.clone()) {
        Err(error) => Ending {
            succeeded: false,
            words: format!("{} could not be started: {error}", job.command[0]),
            last_line: None,
            wall_seconds: begun.elapsed().as_secs_f64(),
            leftovers: Leftovers::default(),
        },
        Ok(group) => wait(group, job, begun),
    };
    let (cpu_seconds, peak_memory_bytes) = Usage::spent_since(before.as_ref());
    Ok(Outcome {
        command: job.command.clone(),
        succeeded: ending.succeeded && ending.leftovers.running.is_empty(),
        left_running: ending.leftovers.lines(),
        ending: ending.leftovers.added_to(ending.words),
        last_line: ending.last_line,
        wall_seconds: ending.wall_seconds,
        cpu_seconds,
        peak_memory_bytes,
    })
}

/// An end, and what was left then.
struct Ending {
    succeeded: bool,
    words: String,
    last_line: Option<String>,
    wall_seconds: f64,
    leftovers: Leftovers,
}

/// Waits for a command or one of its limits, and ends what is running then.
fn wait(mut group: ProcessGroup, job: &Job, begun: Instant) -> Ending {
    let (succeeded, words) = loop {
        match group.try_wait() {
            Ok(Some(status)) => break (status.success(), process::ending(status)),
            Ok(None) => {}
            Err(error) => break (false, format!("an end that the system lost: {error}")),
        }
        if let Some(limit) = job.time_limit.filter(|&limit| begun.elapsed() > limit) {
            break (
                false,
                format!("the time limit of {} s", limit.as_secs_f64()),
            );
        }
        if log_bytes(&job.log) > MOST_LOG_BYTES {
            break (
                false,
                format!("the limit of {MOST_LOG_BYTES} bytes of output"),
            );
        }
        thread::sleep(LOOK_EVERY);
    };
    // Before the end of what is left: that is not its time, and not what it had to say.
    let wall_seconds = begun.elapsed().as_secs_f64();
    let last_line = process::last_line(&job.log);
    Ending {
        succeeded,
        words,
        last_line,
        wall_seconds,
        leftovers: group.end(job.grace),
    }
}

fn log_bytes(log: &Path) -> u64 {
    fs::metadata(log).map_or(0, |metadata| metadata.len())
}

/// What all finished children of this process have used so far.
struct Usage {
    cpu_seconds: f64,
    peak_memory_bytes: u64,
}

impl Usage {
    #[cfg(unix)]
    fn of_children() -> Option<Self> {
        use nix::sys::{
            resource::{UsageWho, getrusage},
            time::TimeValLike,
        };
        let usage = getrusage(UsageWho::RUSAGE_CHILDREN).ok()?;
        let microseconds =
            usage.user_time().num_microseconds() + usage.system_time().num_microseconds();
        // Linux counts kibibytes, macOS bytes.
        let unit = if cfg!(target_os = "macos") { 1 } else { 1024 };
        Some(Self {
            cpu_seconds: microseconds as f64 * 1e-6,
            peak_memory_bytes: u64::try_from(usage.max_rss()).ok()? * unit,
        })
    }

    #[cfg(not(unix))]
    fn of_children() -> Option<Self> {
        None
    }

    /// CPU time since `before`, and the peak memory where it is a new one: the system keeps
    /// only the highest of all children, so a lower one cannot be told.
    fn spent_since(before: Option<&Self>) -> (Option<f64>, Option<u64>) {
        let (Some(before), Some(now)) = (before, Self::of_children()) else {
            return (None, None);
        };
        let is_new = now.peak_memory_bytes > before.peak_memory_bytes;
        (
            Some(now.cpu_seconds - before.cpu_seconds),
            is_new.then_some(now.peak_memory_bytes),
        )
    }
}
