//! Processes: whether they run, and how commands of others ended, in words for a record.

use std::{fs, path::Path, process::ExitStatus};

/// Name of this machine; `unknown` where the system does not tell.
pub fn host_name() -> String {
    #[cfg(unix)]
    if let Ok(name) = nix::unistd::gethostname() {
        return name.to_string_lossy().into_owned();
    }
    "unknown".to_owned()
}

/// Whether a process with this id runs on this machine; where the system does not tell, it does.
pub fn is_running(id: u32) -> bool {
    #[cfg(unix)]
    {
        use nix::{errno::Errno, sys::signal::kill, unistd::Pid};
        i32::try_from(id).is_ok_and(|id| kill(Pid::from_raw(id), None) != Err(Errno::ESRCH))
    }
    #[cfg(not(unix))]
    {
        let _ = id;
        true
    }
}

/// `exit 3`, `signal 9`.
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

/// The last line of a log that is not blank, at most 300 characters of it; logs of other programs
/// need not be UTF-8.
pub fn last_line(log: &Path) -> Option<String> {
    const LONGEST: usize = 300;
    let bytes = fs::read(log).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().rev().map(str::trim);
    let line = lines.find(|line| !line.is_empty())?;
    Some(line.chars().take(LONGEST).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_is_what_a_program_had_to_say() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let log = folder.path().join("log");
        assert_eq!(last_line(&log), None);
        fs::write(&log, b"first\n  broken: \xff \n\n \n")?;
        assert_eq!(last_line(&log).as_deref(), Some("broken: \u{fffd}"));
        fs::write(&log, "x".repeat(1000))?;
        assert_eq!(last_line(&log).map(|line| line.len()), Some(300));
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
