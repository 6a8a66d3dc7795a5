//! Child processes with everything that they start. When the program ends or is ended, all that it has started ends
//! too, and its use of resources is known.
//!
//! There is one way to end them: at a limit, at an interrupt, and where a program leaves something behind. It is
//! SIGTERM, a time of grace, SIGKILL, and a container by its name. On Linux this reaches everything that descends
//! from the program, in whatever group or session. On other systems it reaches the process group (Unix) or the
//! program alone.

mod container;
#[cfg(target_os = "linux")]
mod descendants;
mod job;
#[cfg(all(test, target_os = "linux"))]
mod tests;
mod tree;

use std::{
    convert::Infallible,
    io,
    mem::ManuallyDrop,
    path::Path,
    process::{Child, Command, ExitStatus},
    sync::{Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

pub use container::Container;
pub use job::{Job, new_log, run};
pub use tree::{Leftovers, ProcessTree};
use wait4::Wait4;

use crate::{process, provenance};

/// Time that programs have to clean up when a limit ends them.
pub const GRACE: Duration = Duration::from_secs(5);

/// Longest time between two looks at a running program. Its end is seen up to this much late, which is added to its
/// time at most once.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Time that programs have to clean up when this process is terminated: its caller waits.
const INTERRUPT_GRACE: Duration = Duration::from_secs(1);

/// Running programs of this process, for [`end_all`].
static RUNNING: Mutex<Vec<Running>> = Mutex::new(Vec::new());

struct Running {
    tree: ProcessTree,
    container: Option<Container>,
}

fn running() -> MutexGuard<'static, Vec<Running>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// End of a program, and the resources that it and the children that it waited for have used.
#[derive(Debug, Clone, Copy)]
pub struct Ended {
    /// Status by the system.
    pub status: ExitStatus,
    /// CPU time, user and system.
    pub cpu_time: Duration,
    /// Highest resident memory, bytes, where the system reports it.
    pub peak_memory_bytes: Option<u64>,
}

/// End of a program and of everything that it has started, for a record.
#[derive(Debug, Default)]
pub struct Outcome {
    /// True where it ended by itself and with success, and left nothing running.
    pub succeeded: bool,
    /// Exit code; `None` where a signal ended it, or the system lost it.
    pub exit_code: Option<i32>,
    /// End in words.
    pub ending: String,
    /// Last line that it had printed by then, if any.
    pub last_line: Option<String>,
    /// Processes and containers that were running after its end, or did not end when a limit asked them to, in words.
    /// All have been ended, except those that are marked as still running. The command has failed then.
    pub left_running: Vec<String>,
    /// Wall-clock time until its end or its limit, seconds.
    pub wall_seconds: f64,
    /// CPU time, seconds, where the system reports it.
    pub cpu_seconds: Option<f64>,
    /// Highest resident memory, bytes, where the system reports it.
    pub peak_memory_bytes: Option<u64>,
}

impl Outcome {
    /// Returns the outcome of a program that was not started, for this reason.
    pub fn not_begun(reason: impl Into<String>) -> Self {
        Self {
            ending: reason.into(),
            ..Self::default()
        }
    }

    /// Returns how it ended and the last line that it printed, in words.
    pub fn in_words(&self) -> String {
        let line = self.last_line.iter();
        let line: String = line.map(|line| format!(": {line}")).collect();
        format!("{}{line}", self.ending)
    }

    /// Returns [`Outcome::in_words`] behind the name of a program.
    pub fn failure(&self) -> String {
        format!("ended with {}", self.in_words())
    }
}

/// Running program that leads a process group. Dropping it ends without grace everything that [`ProcessGroup::end`]
/// has not ended.
#[derive(Debug)]
pub struct ProcessGroup {
    leader: Child,
    tree: ProcessTree,
    container: Option<Container>,
    begun: Instant,
    /// Peak memory of this process at the start, bytes: Linux counts it as the child's until the child's own is larger.
    inherited_peak_bytes: u64,
    /// End of the program, once it was waited for.
    ended: Option<Ended>,
    /// True where its end was brought about, or its leftovers were ended.
    is_over: bool,
}

impl ProcessGroup {
    /// Starts a program as the leader of a group of its own. `container` is the container that it runs as the client
    /// of a runtime.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn spawn(command: &mut Command, container: Option<Container>) -> io::Result<Self> {
        let begun = Instant::now();
        // Held over the start: a group either does not start when all are ended, or is among them.
        let mut running = running();
        let (leader, tree) = ProcessTree::spawn(command)?;
        running.push(Running {
            tree: tree.clone(),
            container: container.clone(),
        });
        Ok(Self {
            leader,
            tree,
            container,
            begun,
            inherited_peak_bytes: provenance::peak_memory_bytes().unwrap_or(0),
            ended: None,
            is_over: false,
        })
    }

    /// Returns the program, for its pipes.
    pub fn leader(&mut self) -> &mut Child {
        &mut self.leader
    }

    /// Returns the end of the program, if it has ended. [`ProcessGroup::end`] ends its leftovers.
    ///
    /// # Errors
    /// When the system does not report it.
    pub fn try_wait(&mut self) -> io::Result<Option<Ended>> {
        // Asked for once: afterwards its id may be that of another process.
        if self.ended.is_none() {
            self.ended = self.leader.try_wait4()?.map(|used| Ended {
                status: used.status,
                cpu_time: used.rusage.utime + used.rusage.stime,
                peak_memory_bytes: Some(used.rusage.maxrss)
                    .filter(|&bytes| bytes > self.inherited_peak_bytes),
            });
        }
        Ok(self.ended)
    }

    /// Waits for the end of the program.
    ///
    /// # Errors
    /// When the system does not report it.
    pub fn wait(&mut self) -> io::Result<Ended> {
        let Ok(ended) = self.wait_unless(|_| None::<Infallible>)?;
        Ok(ended)
    }

    /// Waits for the end of the program, or until `limit`, which is called at every look, returns a reason to end it.
    ///
    /// # Errors
    /// When the system does not report it.
    pub fn wait_unless<R>(
        &mut self,
        mut limit: impl FnMut(&ProcessTree) -> Option<R>,
    ) -> io::Result<Result<Ended, R>> {
        let mut pause = Duration::from_millis(1);
        loop {
            if let Some(ended) = self.try_wait()? {
                return Ok(Ok(ended));
            }
            if let Some(reason) = limit(&self.tree) {
                return Ok(Err(reason));
            }
            thread::sleep(pause);
            pause = (2 * pause).min(LOOK_EVERY);
        }
    }

    /// Waits as [`ProcessGroup::wait_unless`] does, and ends everything that still runs. The program prints to `log`.
    pub fn finish(
        mut self,
        log: &Path,
        grace: Duration,
        limit: impl FnMut(&ProcessTree) -> Option<String>,
    ) -> Outcome {
        let waited = self.wait_unless(limit);
        // Taken before the leftovers are ended: neither their time nor their output is that of the program.
        let wall_seconds = self.begun.elapsed().as_secs_f64();
        let last_line = process::last_line(log);
        let leftovers = self.end(grace);
        let (succeeded, words) = match waited {
            Ok(Ok(ended)) => (ended.status.success(), process::ending(ended.status)),
            Ok(Err(limit)) => (false, limit),
            Err(error) => (false, format!("an end that the system lost: {error}")),
        };
        Outcome {
            succeeded: succeeded && leftovers.running.is_empty(),
            exit_code: self.ended.and_then(|ended| ended.status.code()),
            left_running: leftovers.lines(),
            ending: leftovers.added_to(words),
            last_line,
            wall_seconds,
            cpu_seconds: self.ended.map(|ended| ended.cpu_time.as_secs_f64()),
            peak_memory_bytes: self.ended.and_then(|ended| ended.peak_memory_bytes),
        }
    }

    /// Ends the program if it runs, and everything that it has started. Ends its container too, unless the program
    /// has ended with success by itself. Returns when nothing is left, or seconds after the rest was killed.
    pub fn end(&mut self, grace: Duration) -> Leftovers {
        self.is_over = true;
        let ended = self.try_wait().ok().flatten();
        let mut leftovers = if ended.is_some() {
            self.tree.end_rest(grace)
        } else {
            // For systems without groups.
            #[cfg(not(unix))]
            drop(self.leader.kill());
            let tree = self.tree.clone();
            tree::end(&[&tree], grace, &mut || drop(self.try_wait()))
        };
        // It has just ended, and stays a zombie until its status is collected.
        drop(self.try_wait());
        if let Some(container) = &self.container
            && !ended.is_some_and(|ended| ended.status.success())
        {
            match container.kill() {
                Ok(true) => leftovers.ended.push(container.to_string()),
                Ok(false) => {}
                Err(reason) => leftovers.running.push(reason),
            }
        }
        leftovers
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        if !self.is_over {
            drop(self.end(Duration::ZERO));
        }
        running().retain(|other| other.tree != self.tree);
    }
}

/// Ends all programs of this process, which is about to end itself: asks them to end, and kills the rest after a
/// second. Returns descriptions of everything that could not be ended.
///
/// From here on no program starts, and a thread that gives one up waits for ever. A program that was ended here must
/// not be recorded as one that ended by itself.
pub fn end_all() -> Vec<String> {
    // Never given back.
    let programs = ManuallyDrop::new(running());
    let trees: Vec<&ProcessTree> = programs.iter().map(|program| &program.tree).collect();
    let mut left = tree::end(&trees, INTERRUPT_GRACE, &mut || {}).running;
    let containers = programs.iter().filter_map(|one| one.container.as_ref());
    left.extend(containers.filter_map(|container| container.kill().err()));
    left
}
