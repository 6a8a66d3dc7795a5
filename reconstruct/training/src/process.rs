//! State of this process: CPU time, memory, and requests to terminate.

use std::{
    fs,
    path::Path,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use crate::error::ReconstructError;
use omnilife_schemas::provenance::kibibytes;
pub use omnilife_schemas::{elapsed::own_cpu_time, provenance::peak_memory_bytes};

/// Flags between the program's signal handlers and training. This crate installs no handler.
pub static TERMINATION: LazyLock<Termination> = LazyLock::new(|| Termination {
    requested: Arc::default(),
    at_once: Arc::new(AtomicBool::new(true)),
});

/// Flags for signal handlers.
#[derive(Debug)]
pub struct Termination {
    /// Set when the process is told to terminate: training writes a checkpoint and returns.
    pub requested: Arc<AtomicBool>,
    /// True while `requested` is not watched, so that the process should end at once.
    pub at_once: Arc<AtomicBool>,
}

impl Termination {
    /// Promises to watch `requested` until the returned value is dropped.
    pub(crate) fn guard(&self) -> ShutdownGuard<'_> {
        self.at_once.store(false, Ordering::SeqCst);
        ShutdownGuard(self)
    }

    /// Returns true if the process was told to terminate.
    pub(crate) fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}

/// Guard while [`Termination::requested`] is watched.
pub(crate) struct ShutdownGuard<'a>(&'a Termination);

impl Drop for ShutdownGuard<'_> {
    fn drop(&mut self) {
        self.0.at_once.store(true, Ordering::SeqCst);
    }
}

/// Returns the memory that this process can still take without swapping, bytes: the lesser of the free memory of
/// the machine and of its control group. `None` where the system does not report it (other than Linux).
pub fn available_memory_bytes() -> Option<u64> {
    let machine = kibibytes(Path::new("/proc/meminfo"), "MemAvailable:");
    [machine, control_group_bytes()].into_iter().flatten().min()
}

/// Returns the free memory below the limit of a container's control group (version 2), bytes.
fn control_group_bytes() -> Option<u64> {
    let read = |file: &str| -> Option<u64> {
        let path = Path::new("/sys/fs/cgroup").join(file);
        fs::read_to_string(path).ok()?.trim().parse().ok()
    };
    // Without a limit the file has "max" in place of a number.
    Some(read("memory.max")?.saturating_sub(read("memory.current")?))
}

/// Maximum memory for work of this process, bytes; 0 without a limit by the user.
static MEMORY_LIMIT: AtomicU64 = AtomicU64::new(0);

/// Makes [`require`] refuse work beyond this many bytes, however much the machine has.
pub fn limit_memory(bytes: u64) {
    MEMORY_LIMIT.store(bytes, Ordering::Relaxed);
}

/// Returns the limit of [`limit_memory`], bytes.
pub(crate) fn memory_limit() -> Option<u64> {
    Some(MEMORY_LIMIT.load(Ordering::Relaxed)).filter(|&limit| limit > 0)
}

/// Returns the memory that work of this process may still take, bytes: the lesser of the system's free memory and
/// of the limit of [`limit_memory`]. `None` where neither is known.
pub fn left_bytes() -> Option<u64> {
    let left = [available_memory_bytes(), memory_limit()];
    left.into_iter().flatten().min()
}

/// Refuses work that does not fit. `purpose` describes the work.
///
/// Accepts all work without a limit by [`limit_memory`] if the system does not report its free memory (other than
/// Linux).
///
/// # Errors
/// With both figures, when `bytes` is more than what is left.
pub fn require(bytes: u64, purpose: &str) -> Result<(), ReconstructError> {
    match left_bytes() {
        Some(available) if bytes > available => Err(ReconstructError::Memory {
            purpose: purpose.to_owned(),
            gibibytes: gibibytes(bytes),
            available_gibibytes: gibibytes(available),
        }),
        _ => Ok(()),
    }
}

fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 30)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn linux_tells_what_is_left() {
        let available = available_memory_bytes().expect("Linux tells what is left");
        assert!(available > 1 << 20, "{available}");
    }

    #[test]
    fn work_that_does_not_fit_is_refused_with_the_figure() {
        let message = require(u64::MAX, "100,000,000 Gaussians")
            .expect_err("no machine has that much")
            .to_string();
        assert!(
            message.contains("100,000,000 Gaussians") && message.contains("GiB"),
            "{message}"
        );
        require(1 << 20, "a few Gaussians").expect("a mebibyte is left");
    }
}
