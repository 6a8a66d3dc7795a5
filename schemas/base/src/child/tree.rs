//! A program and everything that descends from it: finding, signalling and ending them.

use std::{
    collections::BTreeSet,
    env, fmt, io,
    process::{self, Child, Command},
    sync::atomic::{AtomicU64, Ordering},
    thread,
    time::{Duration, Instant},
};

#[cfg(unix)]
use nix::{
    sys::signal::{Signal, kill, killpg},
    unistd::Pid,
};

/// Variable with the marks of the programs to which a process belongs, from the outermost to the innermost, separated
/// by `:`.
pub(super) const VARIABLE: &str = "OMNILIFE_JOB";
/// Time in which leftovers of a program may end by themselves. Helpers that see that their parent is gone, such as
/// those of Python's `multiprocessing`, do so within milliseconds.
const SETTLE: Duration = Duration::from_millis(500);
/// Time to wait for the end of killed processes.
const AFTER_KILL: Duration = Duration::from_secs(5);
/// Time between two looks at processes that are being ended.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Program that leads a process group, and everything that descends from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessTree {
    /// Process id of the program, and of its group.
    leader: u32,
    /// Its mark in [`VARIABLE`], which identifies a descendant whose parents are gone.
    mark: String,
}

/// Processes and containers that were still running after the end of a program, or after it was asked to end.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Ended: processes, as `sleep (process 4711)`, and containers, as `container omnilife-1`.
    pub ended: Vec<String>,
    /// Processes that could not be ended, with the reason where one is known.
    pub running: Vec<String>,
}

impl Leftovers {
    /// Returns all of them; the lines of those that could not be ended say so.
    pub fn lines(&self) -> Vec<String> {
        let running = self.running.iter();
        let running = running.map(|what| format!("{what}, which could not be ended"));
        self.ended.iter().cloned().chain(running).collect()
    }

    /// Returns an ending in words, with everything that could not be ended.
    pub fn added_to(&self, ending: String) -> String {
        if self.running.is_empty() {
            ending
        } else {
            format!(
                "{ending}, with what could not be ended: {}",
                self.running.join(", ")
            )
        }
    }
}

/// Process that is left of a program; without a name its whole group, where the system does not list processes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Remnant {
    pub(super) id: u32,
    pub(super) name: Option<String>,
}

impl fmt::Display for Remnant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.name {
            Some(name) => write!(f, "{} (process {})", name.escape_debug(), self.id),
            None => write!(f, "the group of process {}", self.id),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum EndSignal {
    /// Asks a process to end, which may still clean up.
    Terminate,
    /// Ends it at once.
    Kill,
}

impl Remnant {
    fn group(leader: u32) -> Self {
        Self {
            id: leader,
            name: None,
        }
    }

    fn signal(&self, how: EndSignal) {
        #[cfg(unix)]
        if let Some(id) = pid(self.id) {
            let signal = match how {
                EndSignal::Terminate => Signal::SIGTERM,
                EndSignal::Kill => Signal::SIGKILL,
            };
            // A process that has ended meanwhile, or may not be signalled, is seen at the next look.
            let _ = match self.name {
                Some(_) => kill(id, signal),
                None => killpg(id, signal),
            };
        }
        #[cfg(not(unix))]
        let _ = how;
    }
}

/// Kills the group that a process leads or led.
pub(super) fn kill_group(leader: u32) {
    Remnant::group(leader).signal(EndSignal::Kill);
}

/// Returns an id that can be signalled: 0 would be the group of this process.
#[cfg(unix)]
fn pid(id: u32) -> Option<Pid> {
    i32::try_from(id)
        .ok()
        .filter(|&id| id > 0)
        .map(Pid::from_raw)
}

impl ProcessTree {
    /// Starts a program as the leader of a group of its own. On Linux this process becomes the parent of
    /// all descendants whose parents end before them, so that they can be found.
    ///
    /// # Errors
    /// When it cannot be started.
    pub(super) fn spawn(command: &mut Command) -> io::Result<(Child, Self)> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let mark = format!("{}-{number}", process::id());
        let marks = match env::var(VARIABLE) {
            Ok(outer) => format!("{outer}:{mark}"),
            Err(_) => mark.clone(),
        };
        command.env(VARIABLE, marks);
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        #[cfg(target_os = "linux")]
        nix::sys::prctl::set_child_subreaper(true)?;
        let child = command.spawn()?;
        let leader = child.id();
        Ok((child, Self { leader, mark }))
    }

    /// Asks the program and the rest of its group to end.
    pub fn ask_group(&self) {
        Remnant::group(self.leader).signal(EndSignal::Terminate);
    }

    /// Kills the program and everything that descends from it, without waiting for the end.
    pub fn kill(&self) {
        for remnant in self.look(&mut BTreeSet::new()) {
            remnant.signal(EndSignal::Kill);
        }
    }

    /// Ends the leftovers of a program that has ended and was waited for. Lets them end by themselves for half a
    /// second, asks them to end, and kills the rest after `grace`.
    pub(super) fn end_rest(&self, grace: Duration) -> Leftovers {
        let begun = Instant::now();
        let mut known = BTreeSet::new();
        let left = loop {
            let left = self.look(&mut known);
            if left.is_empty() {
                return Leftovers::default();
            }
            if begun.elapsed() >= SETTLE {
                break left;
            }
            thread::sleep(LOOK_EVERY);
        };
        let mut leftovers = end(&[self], grace, &mut || {});
        // A process that ended on request had been left running as well.
        for name in left.iter().map(Remnant::to_string) {
            if !leftovers.ended.contains(&name) && !leftovers.running.contains(&name) {
                leftovers.ended.push(name);
            }
        }
        leftovers
    }

    /// Returns its running processes, and waits for orphans among them that have ended. `known` are processes of it
    /// that were seen earlier.
    fn look(&self, known: &mut BTreeSet<u32>) -> Vec<Remnant> {
        #[cfg(target_os = "linux")]
        if let Some(found) = super::descendants::look(self.leader, &self.mark, known) {
            return found;
        }
        #[cfg(not(target_os = "linux"))]
        let _ = known;
        #[cfg(unix)]
        if pid(self.leader).is_some_and(|group| killpg(group, None::<Signal>).is_ok()) {
            return vec![Remnant::group(self.leader)];
        }
        Vec::new()
    }
}

/// Ends programs and everything that descends from them: asks all to end, and kills the rest after `grace`.
/// `at_every_look` reaps the programs, where no other thread does.
pub(super) fn end(
    trees: &[&ProcessTree],
    grace: Duration,
    at_every_look: &mut dyn FnMut(),
) -> Leftovers {
    let mut known = BTreeSet::new();
    let mut signalled = |how: EndSignal, longest: Duration| {
        let begun = Instant::now();
        let mut is_first = true;
        loop {
            at_every_look();
            let left: Vec<Remnant> = trees
                .iter()
                .flat_map(|tree| tree.look(&mut known))
                .collect();
            // Asked once: many programs take a second request as "at once", and the processes that they start for
            // cleaning up have to finish.
            if is_first || how == EndSignal::Kill {
                for remnant in &left {
                    remnant.signal(how);
                }
            }
            if left.is_empty() || begun.elapsed() >= longest {
                return left;
            }
            is_first = false;
            thread::sleep(LOOK_EVERY);
        }
    };
    let stubborn = signalled(EndSignal::Terminate, grace);
    if stubborn.is_empty() {
        return Leftovers::default();
    }
    let left = signalled(EndSignal::Kill, AFTER_KILL);
    let has_ended = |remnant: &&Remnant| left.iter().all(|other| other.id != remnant.id);
    Leftovers {
        ended: stubborn
            .iter()
            .filter(has_ended)
            .map(Remnant::to_string)
            .collect(),
        running: left.iter().map(Remnant::to_string).collect(),
    }
}
