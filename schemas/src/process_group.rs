//! Programs of others, with everything that they start: when the program ends or is ended, its
//! children end too.

use std::{
    io,
    mem::ManuallyDrop,
    process::{Child, Command, ExitStatus},
    sync::{Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// Groups of this process that are running, for [`end_all`].
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

/// How long groups are given to end by themselves when this process is told to end.
const GRACE: Duration = Duration::from_secs(1);

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running program that leads a process group. Dropping it kills what is left of the group.
#[derive(Debug)]
pub struct ProcessGroup {
    leader: Child,
}

impl ProcessGroup {
    /// Starts a program as the leader of a group of its own.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn spawn(command: &mut Command) -> io::Result<Self> {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        // Held over the start: a group is either not begun when all are ended, or among them.
        let mut running = running();
        let leader = command.spawn()?;
        running.push(leader.id());
        Ok(Self { leader })
    }

    /// The program.
    pub fn leader(&mut self) -> &mut Child {
        &mut self.leader
    }

    /// How the program ended, if it has; what it has left behind is killed then.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn try_wait(&mut self) -> io::Result<Option<ExitStatus>> {
        let status = self.leader.try_wait()?;
        if status.is_some() {
            signal(self.leader.id(), GroupSignal::Kill);
        }
        Ok(status)
    }

    /// Kills the program and everything that it started.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn kill(&mut self) -> io::Result<ExitStatus> {
        signal(self.leader.id(), GroupSignal::Kill);
        // Where there are no groups.
        #[cfg(not(unix))]
        self.leader.kill()?;
        self.leader.wait()
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        // It may have ended long ago.
        drop(self.kill());
        let id = self.leader.id();
        running().retain(|&other| other != id);
    }
}

/// How a group is ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroupSignal {
    /// Its processes may still put things in order.
    Terminate,
    /// At once.
    Kill,
}

/// Signals all processes of the group that the process `leader` leads or led.
pub fn signal(leader: u32, how: GroupSignal) {
    #[cfg(unix)]
    {
        use nix::sys::signal::Signal;
        send(
            leader,
            Some(match how {
                GroupSignal::Terminate => Signal::SIGTERM,
                GroupSignal::Kill => Signal::SIGKILL,
            }),
        );
    }
    #[cfg(not(unix))]
    let _ = (leader, how);
}

/// Whether the group had a process that could be signalled; `None` sends nothing and only asks.
#[cfg(unix)]
fn send(leader: u32, signal: Option<nix::sys::signal::Signal>) -> bool {
    // 0 would be the group of this process.
    i32::try_from(leader).is_ok_and(|id| {
        id > 0 && nix::sys::signal::killpg(nix::unistd::Pid::from_raw(id), signal).is_ok()
    })
}

/// Ends all groups of this process, which is about to end itself: asks them to, and kills what is
/// left after a second.
///
/// From here on no group begins, and a thread that gives one up waits for ever: that its program was
/// ended must not be recorded as how the program ended by itself.
pub fn end_all() {
    // Never given back.
    let groups = ManuallyDrop::new(running());
    for &group in groups.iter() {
        signal(group, GroupSignal::Terminate);
    }
    #[cfg(unix)]
    {
        let begun = Instant::now();
        while begun.elapsed() < GRACE && groups.iter().any(|&group| send(group, None)) {
            thread::sleep(Duration::from_millis(20));
        }
    }
    for &group in groups.iter() {
        signal(group, GroupSignal::Kill);
    }
}

#[cfg(all(test, unix))]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use std::{fs, path::Path};

    use super::*;

    /// A shell that starts a child which would write a file after a second and a half.
    fn parent_of_a_writer(file: &Path, rest: &str) -> Command {
        let mut command = Command::new("sh");
        let script = format!("(sleep 1.5; echo late > '{}') & {rest}", file.display());
        command.args(["-c", &script]);
        command
    }

    #[test]
    fn children_end_with_their_program() {
        let temp = tempfile::tempdir().unwrap();
        let [by_itself, killed, dropped] =
            ["itself", "killed", "dropped"].map(|name| temp.path().join(name));
        let mut group = ProcessGroup::spawn(&mut parent_of_a_writer(&by_itself, "exit 3")).unwrap();
        while group.try_wait().unwrap().is_none() {
            thread::sleep(Duration::from_millis(5));
        }
        let mut group = ProcessGroup::spawn(&mut parent_of_a_writer(&killed, "wait")).unwrap();
        assert!(!group.kill().unwrap().success());
        drop(ProcessGroup::spawn(&mut parent_of_a_writer(&dropped, "wait")).unwrap());
        thread::sleep(Duration::from_secs(2));
        for file in [by_itself, killed, dropped] {
            assert!(fs::metadata(&file).is_err(), "{}", file.display());
        }
    }
}
