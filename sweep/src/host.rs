//! Identity of this machine and this process.

use std::time::{SystemTime, UNIX_EPOCH};

use omnilife_schemas::{process::host_name, records::UnitRunner};

fn slurm_job() -> Option<String> {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    match (set("SLURM_ARRAY_JOB_ID"), set("SLURM_ARRAY_TASK_ID")) {
        (Some(array), Some(task)) => Some(format!("{array}_{task}")),
        _ => set("SLURM_JOB_ID"),
    }
}

pub(crate) fn runner() -> UnitRunner {
    UnitRunner {
        host: host_name(),
        process: std::process::id(),
        slurm_job: slurm_job(),
    }
}

pub(crate) fn described(runner: &UnitRunner) -> String {
    let job = runner.slurm_job.as_ref();
    let job = job.map_or_else(String::new, |job| format!(", Slurm job {job}"));
    format!("process {} on {}{job}", runner.process, runner.host)
}

/// Returns seconds since 1970.
pub(crate) fn unix_seconds() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0.0, |time| time.as_secs_f64())
}
