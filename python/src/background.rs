//! Work beside the interpreter: other Python threads continue meanwhile, and Ctrl-C ends it.

use std::{
    panic::{self, AssertUnwindSafe},
    process, ptr,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicPtr, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use omnilife_schemas::progress::Progress;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::Failure;

/// Interval at which Python is asked for signals.
const TICK: Duration = Duration::from_millis(50);
/// Time that interrupted work has to end and to leave its folder in order; after that it is left to itself.
const GRACE: Duration = Duration::from_secs(3);

/// Messages between work and its caller.
#[derive(Debug, Clone, Default)]
pub(crate) struct Link {
    is_given_up: Arc<AtomicBool>,
    notes: Arc<Mutex<Vec<String>>>,
}

impl Link {
    /// Returns the lines for the caller so far.
    pub(crate) fn notes(&self) -> Vec<String> {
        let notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        notes.clone()
    }
}

/// Keeps decisions alone, because no user watches the progress.
impl Progress for Link {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, line: &str) {
        let mut notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        notes.push(line.to_owned());
    }
    fn is_interrupted(&self) -> bool {
        self.is_given_up.load(Ordering::Relaxed)
    }
}

/// Does work on the threads of this process, without the interpreter's lock.
///
/// # Errors
/// Those of the work; `KeyboardInterrupt`, and any exception of another signal handler.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&Link) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let link = Link::default();
    let (sender, mut receiver) = mpsc::channel();
    let of_work = link.clone();
    thread::spawn(move || {
        let outcome =
            panic::catch_unwind(AssertUnwindSafe(|| threads()?.install(|| work(&of_work))));
        let outcome = outcome.unwrap_or_else(|payload| Err(Failure::of_panic(&*payload)));
        // After an interruption the receiver is gone.
        drop(sender.send(outcome));
    });
    loop {
        match wait(py, &mut receiver, TICK) {
            Ok(outcome) => return Ok(outcome?),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::of_panic(&"a thread ended without a word").into());
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(signal) = py.check_signals() {
            link.is_given_up.store(true, Ordering::Relaxed);
            drop(wait(py, &mut receiver, GRACE));
            return Err(signal);
        }
    }
}

/// Waits for an outcome without the interpreter's lock.
fn wait<T: Send>(
    py: Python<'_>,
    receiver: &mut Receiver<Result<T, Failure>>,
    longest: Duration,
) -> Result<Result<T, Failure>, RecvTimeoutError> {
    py.detach(move || receiver.recv_timeout(longest))
}

/// Computing threads, and the process to which they belong.
struct Threads {
    process: u32,
    pool: ThreadPool,
}

/// Returns the threads of this process. A fork inherits no threads of its parent, so that a child that waited for
/// them would wait for ever: it gets its own. Those of the parent are only forgotten, since ending them would mean
/// waiting too.
fn threads() -> Result<&'static ThreadPool, Failure> {
    static THREADS: AtomicPtr<Threads> = AtomicPtr::new(ptr::null_mut());
    let held = THREADS.load(Ordering::Acquire);
    // SAFETY: the pointer is null or comes from `Box::leak` below and is never freed.
    if let Some(threads) = unsafe { held.as_ref() }
        && threads.process == process::id()
    {
        return Ok(&threads.pool);
    }
    let pool = ThreadPoolBuilder::new()
        .build()
        .map_err(|error| Failure::of_panic(&error.to_string()))?;
    let made = Box::leak(Box::new(Threads {
        process: process::id(),
        pool,
    }));
    // Two threads that come first at the same time make two pools, of which the later one stays.
    THREADS.store(made, Ordering::Release);
    Ok(&made.pool)
}
