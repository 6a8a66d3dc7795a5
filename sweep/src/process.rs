//! One command, run until it ends or is ended, and its cost.

use std::{
    fs::File,
    io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
};

use omnilife_schemas::child::{GRACE, Outcome, ProcessGroup, ProcessTree};

/// Command and its environment.
pub(crate) struct Job<'a> {
    /// Program and arguments; the program `omnilife` is `program`.
    pub(crate) command: &'a [String],
    pub(crate) program: &'a Path,
    /// Working directory.
    pub(crate) folder: &'a Path,
    /// Variables set beside those of this process.
    pub(crate) variables: &'a [(String, String)],
    /// File to which all output is appended.
    pub(crate) log: &'a Path,
    /// Locked file that the command and its children inherit, and with it the lock.
    pub(crate) lock: Option<&'a File>,
}

/// Reason for ending a command early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum EndReason {
    /// The runner was asked to end.
    Stop,
    /// The unit has used up its time.
    Limit,
}

/// Requests of other threads to the running command of a unit; the thread that waits for it carries them out.
#[derive(Debug, Default)]
pub(crate) struct Running {
    asked: Mutex<UnitRequests>,
}

#[derive(Debug, Default)]
struct UnitRequests {
    /// First reason that was given for the end.
    reason: Option<EndReason>,
    /// True where it has to end at once.
    at_once: bool,
}

impl Running {
    fn asked(&self) -> MutexGuard<'_, UnitRequests> {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the reason why the unit is being ended, if it is.
    pub(crate) fn reason(&self) -> Option<EndReason> {
        self.asked().reason
    }

    /// Asks the command and the rest of its group to end; no further one of the unit starts. Processes that have left
    /// the group are ended after the command: programs that run others end those themselves.
    pub(crate) fn end(&self, reason: EndReason) {
        self.asked().reason.get_or_insert(reason);
    }

    /// Kills the command and all its descendants.
    pub(crate) fn kill(&self) {
        self.asked().at_once = true;
    }

    /// Passes new requests on to a command.
    fn pass_on(&self, tree: &ProcessTree, is_told: &mut bool) {
        let asked = self.asked();
        if asked.at_once {
            tree.kill();
        } else if asked.reason.is_some() && !std::mem::replace(is_told, true) {
            tree.ask_group();
        }
    }
}

/// Runs a command with no standard input and both outputs in the log, and ends processes that it leaves running: the
/// next one must not share the machine with them. It does not outlive this process (Linux).
///
/// # Errors
/// When the log cannot be written or the command cannot be started, with the file in words.
pub(crate) fn run(job: &Job<'_>, running: &Running) -> io::Result<Outcome> {
    if running.reason().is_some() {
        return Ok(Outcome::not_begun("not begun"));
    }
    let log = File::options().create(true).append(true).open(job.log)?;
    let errors = log.try_clone()?;
    let program = resolved(job);
    let mut command = dying_with_its_runner(&program);
    command
        .args(&job.command[1..])
        .envs(job.variables.iter().map(|(name, value)| (name, value)))
        .current_dir(job.folder)
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(errors);
    let group = {
        let handed_down = job.lock.map(inheritable).transpose();
        let _handed_down = handed_down.map_err(|error| {
            let reason = format!("its lock cannot be handed down, for want of open files: {error}");
            io::Error::new(error.kind(), reason)
        })?;
        ProcessGroup::spawn(&mut command, None).map_err(|error| {
            let reason = format!("{}: cannot be started: {error}", program.display());
            io::Error::new(error.kind(), reason)
        })?
    };
    let mut is_told = false;
    Ok(group.finish(job.log, GRACE, |tree| {
        running.pass_on(tree, &mut is_told);
        None
    }))
}

/// Least number of inherited files. Shells and scripts open theirs under single digits, and a command that opens one
/// under the number of its unit's lock would release the lock.
#[cfg(unix)]
const FIRST_INHERITED_DESCRIPTOR: i32 = 100;

/// Returns a copy of an open file that programs started meanwhile inherit. One started for another unit at the same
/// moment inherits it too; the lock is released for all of them.
fn inheritable(file: &File) -> io::Result<File> {
    #[cfg(unix)]
    {
        let copy = rustix::io::fcntl_dupfd_cloexec(file, FIRST_INHERITED_DESCRIPTOR)?;
        rustix::io::fcntl_setfd(&copy, rustix::io::FdFlags::empty())?;
        Ok(File::from(copy))
    }
    #[cfg(not(unix))]
    file.try_clone()
}

fn resolved(job: &Job<'_>) -> PathBuf {
    match job.command[0].as_str() {
        "omnilife" => job.program.to_owned(),
        other => PathBuf::from(other),
    }
}

/// Returns a command that dies with the thread that started it and waits for it (Linux).
///
/// Requesting that between fork and exec copies all of this program's address space, with its many libraries, for every
/// command. `setpriv` of util-linux requests it afterwards, in a small process of its own; without it, the copy is
/// made. Processes that a killed runner leaves behind all the same hold the unit's lock, and are waited for.
fn dying_with_its_runner(program: &Path) -> Command {
    #[cfg(target_os = "linux")]
    {
        const ARGUMENTS: [&str; 3] = ["--pdeathsig", "KILL", "--"];
        static HAS_SETPRIV: std::sync::LazyLock<bool> = std::sync::LazyLock::new(|| {
            let mut probe = Command::new("setpriv");
            probe.args(ARGUMENTS).arg("true").stdin(Stdio::null());
            let status = probe.stdout(Stdio::null()).stderr(Stdio::null()).status();
            status.is_ok_and(|status| status.success())
        });
        if *HAS_SETPRIV {
            let mut command = Command::new("setpriv");
            command.args(ARGUMENTS).arg(program);
            return command;
        }
        let mut command = Command::new(program);
        die_with_parent(&mut command);
        command
    }
    #[cfg(not(target_os = "linux"))]
    Command::new(program)
}

#[cfg(target_os = "linux")]
fn die_with_parent(command: &mut Command) {
    use std::os::unix::process::CommandExt;
    let parent = nix::unistd::getpid();
    let ask = move || {
        nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL)?;
        // A parent that died before the call above sends no signal any more.
        if nix::unistd::getppid() == parent {
            Ok(())
        } else {
            Err(io::Error::from(io::ErrorKind::BrokenPipe))
        }
    };
    // SAFETY: between fork and exec the closure makes two system calls and allocates nothing.
    unsafe { command.pre_exec(ask) };
}
