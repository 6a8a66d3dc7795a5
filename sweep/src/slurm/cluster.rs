//! The programs of Slurm.

use std::{
    collections::BTreeSet,
    io::Write,
    process::{Command, Output, Stdio},
};

use super::answers;
use crate::error::SweepError;

/// Returns one more than the highest index of an array's tasks, and thereby the most tasks of an array.
///
/// # Errors
/// When Slurm does not report it.
pub(super) fn max_array_size() -> Result<usize, SweepError> {
    let text = output("scontrol", &["show", "config"], None)?;
    answers::max_array_size(&text)
        .ok_or_else(|| failed("scontrol show config", "does not say MaxArraySize"))
}

/// Returns all array tasks that wait or run, as `<array>_<task>`.
///
/// # Errors
/// When Slurm does not report them.
pub(super) fn queued_tasks() -> Result<BTreeSet<String>, SweepError> {
    let text = output("squeue", &["--noheader", "--array", "--format=%F_%K"], None)?;
    Ok(answers::queued_tasks(&text))
}

/// Submits a script and returns the job's id.
///
/// # Errors
/// When Slurm refuses.
pub(super) fn sbatch(options: &[String], script: &str) -> Result<String, SweepError> {
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let text = output("sbatch", &options, Some(script))?;
    answers::job_id(&text).ok_or_else(|| failed("sbatch", "printed no job id"))
}

/// Puts a running job back into the queue.
///
/// # Errors
/// When Slurm refuses.
pub(super) fn requeue(job: &str) -> Result<(), SweepError> {
    output("scontrol", &["requeue", job], None).map(drop)
}

fn output(program: &str, arguments: &[&str], input: Option<&str>) -> Result<String, SweepError> {
    let run = || -> std::io::Result<Output> {
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        if let (Some(mut pipe), Some(input)) = (child.stdin.take(), input) {
            pipe.write_all(input.as_bytes())?;
        }
        child.wait_with_output()
    };
    let output = run().map_err(|error| failed(program, &error.to_string()))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let message = String::from_utf8_lossy(&output.stderr);
    let reason = message.lines().next().unwrap_or("failed without a word");
    Err(failed(program, reason))
}

fn failed(command: &str, reason: &str) -> SweepError {
    SweepError::Slurm {
        command: command.to_owned(),
        reason: reason.to_owned(),
    }
}
