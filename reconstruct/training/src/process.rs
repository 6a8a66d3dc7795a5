//! What the system says about this process: time on the CPU, memory, and that it shall end.

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

/// What the program's signal handlers and training tell each other. This crate installs no handler.
pub static TERMINATION: LazyLock<Termination> = LazyLock::new(|| Termination {
    requested: Arc::default(),
    at_once: Arc::new(AtomicBool::new(true)),
});

/// Flags for signal handlers.
#[derive(Debug)]
pub struct Termination {
    /// To be set when the process was told to end: training writes a checkpoint and returns.
    pub requested: Arc<AtomicBool>,
    /// While it is set nobody looks at `requested`, and the process had better end at once.
    pub at_once: Arc<AtomicBool>,
}

impl Termination {
    /// Promises to look at `requested` until the returned value is dropped.
    pub(crate) fn guard(&self) -> ShutdownGuard<'_> {
        self.at_once.store(false, Ordering::SeqCst);
        ShutdownGuard(self)
    }

    /// Whether the process was told to end.
    pub(crate) fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}

/// Somebody looks at [`Termination::requested`].
pub(crate) struct ShutdownGuard<'a>(&'a Termination);

impl Drop for ShutdownGuard<'_> {
    fn drop(&mut self) {
        self.0.at_once.store(true, Ordering::SeqCst);
    }
}

/// Memory that this process could still take without swapping, bytes, where the system tells
/// (Linux): the less of what the machine and what its control group have left.
pub fn available_memory_bytes() -> Option<u64> {
    let machine = kibibytes(Path::new("/proc/meminfo"), "MemAvailable:");
    [machine, control_group_bytes()].into_iter().flatten().min()
}

/// What is left below the limit of a container's control group (version 2).
fn control_group_bytes() -> Option<u64> {
    let read = |file: &str| -> Option<u64> {
        let path = Path::new("/sys/fs/cgroup").join(file);
        fs::read_to_string(path).ok()?.trim().parse().ok()
    };
    // Without a limit the file says "max", which is no number.
    Some(read("memory.max")?.saturating_sub(read("memory.current")?))
}

/// Most memory that work of this process may take, bytes; 0 where the user gave no limit.
static MEMORY_LIMIT: AtomicU64 = AtomicU64::new(0);

/// From here on [`require`] refuses what takes more than this many bytes, however much the machine has.
pub fn limit_memory(bytes: u64) {
    MEMORY_LIMIT.store(bytes, Ordering::Relaxed);
}

/// The limit of [`limit_memory`], bytes.
pub(crate) fn memory_limit() -> Option<u64> {
    Some(MEMORY_LIMIT.load(Ordering::Relaxed)).filter(|&limit| limit > 0)
}

/// Returns the memory that work of this process may still take, bytes: the less of what the system has left and of the limit
/// of [`limit_memory`]; `None` where neither is known.
pub fn left_bytes() -> Option<u64> {
    let left = [available_memory_bytes(), memory_limit()];
    left.into_iter().flatten().min()
}

/// Refuses work that does not fit. `purpose` says what would be made.
///
/// Without a limit by [`limit_memory`], and where the system does not say what it has left (elsewhere
/// than on Linux), nothing is refused.
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
