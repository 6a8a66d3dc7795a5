//! Origin of a record: the program with its commit, and the machine.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    sync::OnceLock,
    time::{SystemTime, UNIX_EPOCH},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Entry of the program's version in a record's versions.
const PROGRAM: &str = "omnilife";
/// Entry of the commit that the program was built from.
const COMMIT: &str = "omnilife commit";
/// Stands for an unknown commit.
const UNKNOWN: &str = "unknown";

static BUILT_FROM: OnceLock<&'static str> = OnceLock::new();

/// States once from which commit the program was built. The binary knows it, because its build script asks git, and
/// states it first of all; a library does not know it. An empty text states nothing.
pub fn state_commit(commit: &'static str) {
    if !commit.is_empty() {
        // A second statement changes nothing: a process has been built once.
        let _ = BUILT_FROM.set(commit);
    }
}

/// Returns the commit that the program was built from, 40 hexadecimal digits, with `-changed` after them where files
/// differed from it. It is `unknown` in a build without git and in a library's test.
pub fn commit() -> &'static str {
    BUILT_FROM.get().copied().unwrap_or(UNKNOWN)
}

/// Returns name, version and commit of this program, as records carry them.
pub fn versions() -> BTreeMap<String, String> {
    BTreeMap::from([
        (PROGRAM.to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        (COMMIT.to_owned(), commit().to_owned()),
    ])
}

/// Returns the commit among a record's versions; `None` where it is unknown.
pub fn commit_in(versions: &BTreeMap<String, String>) -> Option<&str> {
    let commit = versions.get(COMMIT).map(String::as_str);
    commit.filter(|&commit| commit != UNKNOWN)
}

/// The machine that computed something.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Hardware {
    /// The CPU as it calls itself, where the system tells (Linux).
    pub processor: Option<String>,
    /// Threads that this process may run at once.
    pub threads: u32,
    /// Memory of the machine in bytes, where the system tells (Linux).
    pub memory_bytes: Option<u64>,
    /// Operating system and instruction set, `linux x86_64`.
    pub system: String,
}

impl Hardware {
    /// Returns the machine that this process runs on.
    pub fn here() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self {
            processor: processor(),
            threads: u32::try_from(threads).unwrap_or(u32::MAX),
            memory_bytes: kibibytes(Path::new("/proc/meminfo"), "MemTotal:"),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

fn processor() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let mut lines = text.lines().filter_map(|line| line.split_once(':'));
    let (_, name) = lines.find(|(key, _)| key.trim() == "model name")?;
    Some(name.trim().to_owned())
}

/// Returns the highest resident memory of this process so far, bytes, where the system reports it (Linux).
pub fn peak_memory_bytes() -> Option<u64> {
    kibibytes(Path::new("/proc/self/status"), "VmHWM:")
}

/// Returns an entry of one of Linux's tables of sizes, such as `/proc/meminfo`, in bytes.
pub fn kibibytes(file: &Path, key: &str) -> Option<u64> {
    let text = fs::read_to_string(file).ok()?;
    let rest = text.lines().find_map(|line| line.strip_prefix(key))?;
    let kibibytes: u64 = rest.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

/// Returns a time as `2026-01-31 23:59:59 UTC`.
pub fn utc(time: SystemTime) -> String {
    let seconds = time
        .duration_since(UNIX_EPOCH)
        .map_or(0, |time| time.as_secs());
    let (mut days, second) = (seconds / 86_400, seconds % 86_400);
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!(
        "{year}-{month:02}-{:02} {hour:02}:{minute:02}:{second:02} UTC",
        days + 1
    )
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        let at = |seconds| utc(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(at(951_782_399), "2000-02-28 23:59:59 UTC");
        assert_eq!(at(951_782_400), "2000-02-29 00:00:00 UTC");
        assert_eq!(at(1_735_689_599), "2024-12-31 23:59:59 UTC");
    }

    #[test]
    fn an_empty_commit_is_unknown() {
        state_commit("");
        assert_eq!(versions()[COMMIT], UNKNOWN);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn linux_tells_what_it_runs_on() {
        let here = Hardware::here();
        assert!(here.threads > 0 && here.system.starts_with("linux "));
        assert!(here.memory_bytes.expect("a size") > 1 << 24, "{here:?}");
        let peak = peak_memory_bytes().expect("a peak");
        assert!((1 << 20..1 << 40).contains(&peak), "{peak}");
    }
}
