//! Commands of external programs, run to their end or their limits with their output in a log.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use super::{Container, Outcome, ProcessGroup};
use crate::store::{self, StoreError};

/// Command to run, with its environment and limits.
#[derive(Debug)]
pub struct Job {
    /// Program and arguments.
    pub command: Vec<String>,
    /// Variables that are added to those of this process.
    pub variables: BTreeMap<String, String>,
    /// Working directory.
    pub folder: PathBuf,
    /// File for everything it prints.
    pub log: PathBuf,
    /// Time after which it is ended, with everything that it started.
    pub time_limit: Option<Duration>,
    /// Time that it has to clean up before it is killed.
    pub grace: Duration,
    /// Container that it runs, where it is the client of a runtime.
    pub container: Option<Container>,
}

/// Largest output of a command, bytes; a command that prints more is ended, because it would fill the disk.
const MOST_LOG_BYTES: u64 = 4 << 30;

/// Opens an empty log for the output of a program.
///
/// # Errors
/// When it cannot be written.
#[cfg_attr(
    not(test),
    expect(
        clippy::disallowed_methods,
        reason = "a log is read while it is written, and by halves too"
    )
)]
pub fn new_log(path: &Path) -> Result<File, StoreError> {
    File::create(path).map_err(|source| StoreError::write(path, source))
}

/// Runs a command with no standard input and both outputs in the log.
///
/// # Errors
/// When the log cannot be written, or the machine has no room for another process. A command that cannot be started for
/// a reason of its own is an outcome.
pub fn run(job: &Job) -> Result<Outcome, StoreError> {
    let log = new_log(&job.log)?;
    let errors = log.try_clone();
    let errors = errors.map_err(|source| StoreError::write(&job.log, source))?;
    let begun = Instant::now();
    let mut command = Command::new(&job.command[0]);
    command
        .args(&job.command[1..])
        .envs(&job.variables)
        .current_dir(&job.folder)
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(errors);
    let group = match ProcessGroup::spawn(&mut command, job.container.clone()) {
        Ok(group) => group,
        Err(error) if store::is_of_machine(&error) => {
            return Err(StoreError::read(Path::new(&job.command[0]), error));
        }
        Err(error) => {
            let program = &job.command[0];
            let reason = format!("{program} could not be started: {error}");
            return Ok(Outcome::not_begun(reason));
        }
    };
    Ok(group.finish(&job.log, job.grace, |_| {
        let time_limit = job.time_limit.filter(|&limit| begun.elapsed() > limit);
        if let Some(limit) = time_limit {
            return Some(format!("the time limit of {} s", limit.as_secs_f64()));
        }
        let printed = fs::metadata(&job.log).map_or(0, |metadata| metadata.len());
        (printed > MOST_LOG_BYTES).then(|| format!("the limit of {MOST_LOG_BYTES} bytes of output"))
    }))
}
