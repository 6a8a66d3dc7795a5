//! Programs of others, with everything that they start: when the program ends or is ended, what it
//! has started ends too.
//!
//! There is one way to end them, at a limit, at an interrupt, and where a program leaves something
//! behind: SIGTERM, a time of grace, SIGKILL, and a container by its name. On Linux this reaches
//! everything that descends from the program, in whatever group or session; on other systems its
//! process group (Unix) or the program alone.

mod container;
#[cfg(target_os = "linux")]
mod descendants;
#[cfg(all(test, target_os = "linux"))]
mod tests;
mod tree;

use std::{
    io,
    mem::ManuallyDrop,
    process::{Child, Command, ExitStatus},
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

pub use container::Container;
pub use tree::{Leftovers, ProcessTree};

/// Time that programs have to put things in order when a limit ends them.
pub const GRACE: Duration = Duration::from_secs(5);

/// Time that they have when this process is told to end: whoever told it waits.
const INTERRUPT_GRACE: Duration = Duration::from_secs(1);

/// Programs of this process that are running, for [`end_all`].
static RUNNING: Mutex<Vec<Running>> = Mutex::new(Vec::new());

struct Running {
    tree: ProcessTree,
    container: Option<Container>,
}

fn running() -> MutexGuard<'static, Vec<Running>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running program that leads a process group. Dropping it ends what [`ProcessGroup::end`] has not,
/// without grace.
#[derive(Debug)]
pub struct ProcessGroup {
    leader: Child,
    tree: ProcessTree,
    container: Option<Container>,
    has_ended: bool,
}

impl ProcessGroup {
    /// Starts a program as the leader of a group of its own. `container` is the one that it runs, as
    /// the client of a runtime.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn spawn(command: &mut Command, container: Option<Container>) -> io::Result<Self> {
        // Held over the start: a group is either not begun when all are ended, or among them.
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
            has_ended: false,
        })
    }

    /// The program.
    pub fn leader(&mut self) -> &mut Child {
        &mut self.leader
    }

    /// Status of the program, if it has ended. What it has left behind is for [`ProcessGroup::end`].
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn try_wait(&mut self) -> io::Result<Option<ExitStatus>> {
        self.leader.try_wait()
    }

    /// Ends the program if it runs, and everything that it has started; its container too, unless the
    /// program has ended with success by itself. Returns when nothing is left, or seconds after what
    /// is left was killed.
    pub fn end(&mut self, grace: Duration) -> Leftovers {
        self.has_ended = true;
        let status = self.leader.try_wait().ok().flatten();
        let mut leftovers = if status.is_some() {
            self.tree.end_rest(grace)
        } else {
            // Where there are no groups.
            #[cfg(not(unix))]
            drop(self.leader.kill());
            let leader = &mut self.leader;
            tree::end(&[&self.tree], grace, &mut || drop(leader.try_wait()))
        };
        // It has just ended, and stays a zombie until it is asked how.
        drop(self.leader.try_wait());
        if let Some(container) = &self.container
            && !status.is_some_and(|status| status.success())
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
        if !self.has_ended {
            drop(self.end(Duration::ZERO));
        }
        running().retain(|other| other.tree != self.tree);
    }
}

/// Ends all programs of this process, which is about to end itself: asks them to, and kills what is
/// left after a second. Returns what could not be ended.
///
/// From here on no program begins, and a thread that gives one up waits for ever: that its program was
/// ended must not be recorded as how the program ended by itself.
pub fn end_all() -> Vec<String> {
    // Never given back.
    let programs = ManuallyDrop::new(running());
    let trees: Vec<&ProcessTree> = programs.iter().map(|program| &program.tree).collect();
    let mut left = tree::end(&trees, INTERRUPT_GRACE, &mut || {}).running;
    let containers = programs.iter().filter_map(|one| one.container.as_ref());
    left.extend(containers.filter_map(|container| container.kill().err()));
    left
}
