//! Processes: their state, the resources that external commands may use, and their end in words for a record.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
    process::ExitStatus,
};

/// Returns the name of this machine; `unknown` where the system does not report it.
pub fn host_name() -> String {
    #[cfg(unix)]
    if let Ok(name) = nix::unistd::gethostname() {
        return name.to_string_lossy().into_owned();
    }
    "unknown".to_owned()
}

/// Entry of a process in Linux's list of processes.
#[cfg(target_os = "linux")]
#[derive(Debug)]
pub(crate) struct Stat {
    /// Name of its program, cut off after 15 bytes.
    pub(crate) name: String,
    /// True for a process that has ended and whose parent has not collected its status.
    pub(crate) has_ended: bool,
    /// Ids of its parent, its process group and its session; 0 where the system gives none.
    pub(crate) parent: u32,
    pub(crate) group: u32,
    pub(crate) session: u32,
}

#[cfg(target_os = "linux")]
impl Stat {
    /// Returns the process with this id, if it exists.
    pub(crate) fn of(id: u32) -> Option<Self> {
        let bytes = std::fs::read(format!("/proc/{id}/stat")).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        // The name, in parentheses, may hold anything; the state is the letter behind it.
        let (head, rest) = text.rsplit_once(')')?;
        let (_, name) = head.split_once('(')?;
        let mut fields = rest.split_whitespace();
        let has_ended = fields.next()?.starts_with(['Z', 'X']);
        let mut number = || fields.next().map_or(0, |field| field.parse().unwrap_or(0));
        Some(Self {
            name: name.to_owned(),
            has_ended,
            parent: number(),
            group: number(),
            session: number(),
        })
    }
}

/// Returns whether a process has ended and its parent has not collected its status; known on Linux alone.
#[cfg(unix)]
fn is_zombie(id: u32) -> bool {
    #[cfg(target_os = "linux")]
    {
        Stat::of(id).is_some_and(|stat| stat.has_ended)
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = id;
        false
    }
}

/// Returns whether a process with this id runs on this machine; true where the system does not tell.
pub fn is_running(id: u32) -> bool {
    #[cfg(unix)]
    {
        use nix::{errno::Errno, sys::signal::kill, unistd::Pid};
        let exists =
            i32::try_from(id).is_ok_and(|id| kill(Pid::from_raw(id), None) != Err(Errno::ESRCH));
        exists && !is_zombie(id)
    }
    #[cfg(not(unix))]
    {
        let _ = id;
        true
    }
}

/// Returns an ending in words: `exit 3`, `signal 9`.
pub fn ending(status: ExitStatus) -> String {
    #[cfg(unix)]
    {
        use std::os::unix::process::ExitStatusExt;
        if let Some(signal) = status.signal() {
            return format!("signal {signal}");
        }
    }
    status
        .code()
        .map_or_else(|| "no exit code".to_owned(), |code| format!("exit {code}"))
}

/// Returns the last line of a log that is not blank, at most 300 characters of it. Logs of other programs need not be
/// UTF-8.
pub fn last_line(log: &Path) -> Option<String> {
    last_line_of(&tail(log).ok()?)
}

/// Returns the [`last_line`] of a program's output.
pub fn last_line_of(printed: &[u8]) -> Option<String> {
    const LONGEST: usize = 300;
    let text = String::from_utf8_lossy(printed);
    let mut lines = text.lines().rev().map(str::trim);
    let line = lines.find(|line| !line.is_empty())?;
    Some(line.chars().take(LONGEST).collect())
}

/// Returns the last bytes of a log of any length.
fn tail(log: &Path) -> io::Result<Vec<u8>> {
    const BYTES: u64 = 64 << 10;
    let mut file = File::open(log)?;
    let begin = file.metadata()?.len().saturating_sub(BYTES);
    file.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    // It may grow while it is read.
    file.take(BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Returns the last bytes of a pipe, after any number of others.
pub fn read_tail(pipe: Option<impl Read>, most: usize) -> Vec<u8> {
    let Some(mut pipe) = pipe else {
        return Vec::new();
    };
    let mut tail = Vec::new();
    let mut block = [0; 8 << 10];
    // Output in front of a broken pipe is shown like any error.
    while let Ok(read @ 1..) = pipe.read(&mut block) {
        tail.extend_from_slice(&block[..read]);
        let spare = tail.len().saturating_sub(most);
        tail.drain(..spare);
    }
    tail
}

/// Limits the private writable memory of this process for good; requests for more fail. Systems without such a limit
/// (all but Linux) are left as they are.
///
/// # Errors
/// When the system refuses.
pub fn limit_memory(bytes: u64) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use nix::sys::resource::{Resource, getrlimit, setrlimit};
        let (soft, hard) = getrlimit(Resource::RLIMIT_DATA)?;
        let bytes = bytes.min(soft).min(hard);
        setrlimit(Resource::RLIMIT_DATA, bytes, bytes)?;
    }
    #[cfg(not(target_os = "linux"))]
    let _ = bytes;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn an_ended_process_that_was_not_waited_for_does_not_run() {
        let mut child = std::process::Command::new("true")
            .spawn()
            .expect("true is there");
        let is_gone = || !is_running(child.id());
        let waited = (0..200).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(10));
            is_gone()
        });
        assert!(waited && is_running(std::process::id()));
        child.wait().expect("it has ended");
    }

    #[test]
    #[cfg(unix)]
    fn the_last_line_is_what_a_program_had_to_say() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let log = folder.path().join("log");
        assert_eq!(last_line(&log), None);
        fs::write(&log, b"first\n  broken: \xff \n\n \n")?;
        assert_eq!(last_line(&log).as_deref(), Some("broken: \u{fffd}"));
        fs::write(&log, "x".repeat(1000))?;
        assert_eq!(last_line(&log).map(|line| line.len()), Some(300));
        // A sparse log of a terabyte, of which only the last bytes are stored.
        let file = File::create(&log)?;
        file.set_len(1 << 40)?;
        std::os::unix::fs::FileExt::write_all_at(&file, b"\nthe end\n", 1 << 40)?;
        assert_eq!(last_line(&log).as_deref(), Some("the end"));
        Ok(())
    }

    #[test]
    #[cfg(unix)]
    fn endings_are_told_apart() {
        use std::os::unix::process::ExitStatusExt;
        assert_eq!(ending(ExitStatus::from_raw(3 << 8)), "exit 3");
        assert_eq!(ending(ExitStatus::from_raw(9)), "signal 9");
    }
}
