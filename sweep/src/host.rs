//! What this machine and its processes say about themselves.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use omnilife_schemas::{
    process::host_name,
    records::{UnitClaim, UnitRunner},
    store::StoreError,
};

/// Variable by which every process of a unit can be told.
pub(crate) const TOKEN_VARIABLE: &str = "OMNILIFE_SWEEP_CLAIM";

/// The Slurm job that this process is part of.
fn slurm_job() -> Option<String> {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    match (set("SLURM_ARRAY_JOB_ID"), set("SLURM_ARRAY_TASK_ID")) {
        (Some(array), Some(task)) => Some(format!("{array}_{task}")),
        _ => set("SLURM_JOB_ID"),
    }
}

/// This process as a runner.
pub(crate) fn runner() -> UnitRunner {
    UnitRunner {
        host: host_name(),
        process: std::process::id(),
        slurm_job: slurm_job(),
    }
}

/// The running kernel and the process namespace of this process (Linux): within both, a process id
/// names one process at a time.
pub(crate) fn kernel() -> Option<String> {
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    Some(format!("{} {}", boot.trim(), namespace.display()))
}

/// When a process began, in ticks since the kernel did (proc(5): field 22 of `stat`); `None` where
/// there is no such process.
pub(crate) fn process_begun_ticks(process: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The second field is the program's name in parentheses and may hold anything.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace();
    let is_zombie = fields.next() == Some("Z");
    let begun = fields.nth(18)?.parse().ok()?;
    (!is_zombie).then_some(begun)
}

/// Whether the runner of a claim runs; `None` where this process cannot tell.
pub(crate) fn is_running(claim: &UnitClaim) -> Option<bool> {
    let (theirs, ours) = (claim.kernel.as_ref()?, kernel()?);
    (*theirs == ours).then(|| {
        let begun = process_begun_ticks(claim.runner.process);
        begun.is_some() && begun == claim.process_begun_ticks
    })
}

/// Kills every process that a claim's unit has left behind on this machine (Linux), and waits until
/// they are gone: they must not write into the unit's files while it is done again.
pub(crate) fn end_leftovers(claim: &UnitClaim) {
    const LONGEST: Duration = Duration::from_secs(5);
    let begun = Instant::now();
    while kill_leftovers(claim) && begun.elapsed() < LONGEST {
        thread::sleep(Duration::from_millis(5));
    }
}

/// Whether there were any.
#[cfg(target_os = "linux")]
fn kill_leftovers(claim: &UnitClaim) -> bool {
    use nix::{
        sys::signal::{Signal, kill},
        unistd::Pid,
    };
    let wanted = format!("{TOKEN_VARIABLE}={}", claim.token);
    let mut found = false;
    let processes = fs::read_dir("/proc").into_iter().flatten();
    for entry in processes.filter_map(Result::ok) {
        let name = entry.file_name();
        let Some(process) = name.to_str().and_then(|name| name.parse::<i32>().ok()) else {
            continue;
        };
        // Empty for one that has ended and waits for its parent.
        let variables = fs::read(entry.path().join("environ")).unwrap_or_default();
        let mut variables = variables.split(|&byte| byte == 0);
        if variables.any(|variable| variable == wanted.as_bytes()) {
            // It may have ended by itself since.
            let _ = kill(Pid::from_raw(process), Signal::SIGKILL);
            found = true;
        }
    }
    found
}

#[cfg(not(target_os = "linux"))]
fn kill_leftovers(_: &UnitClaim) -> bool {
    false
}

/// A text that no other claim has.
pub(crate) fn token() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let nanoseconds = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |time| time.as_nanos());
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    format!(
        "{}-{}-{nanoseconds}-{count}",
        host_name(),
        std::process::id()
    )
}

/// Seconds since 1970.
pub(crate) fn unix_seconds() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0.0, |time| time.as_secs_f64())
}

/// What time it is for the file system of a folder. Machines' clocks differ, and a claim's age is
/// by the clock that dates its file.
pub(crate) fn file_system_time(folder: &Path) -> Result<SystemTime, StoreError> {
    let path = folder.join(format!(".clock-{}", std::process::id()));
    let failed = |source| StoreError::write(&path, source);
    fs::write(&path, b"now\n").map_err(failed)?;
    let time = fs::metadata(&path).and_then(|metadata| metadata.modified());
    fs::remove_file(&path).map_err(failed)?;
    time.map_err(failed)
}
