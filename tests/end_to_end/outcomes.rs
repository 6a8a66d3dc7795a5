//! Content of a command's folder, as far as two undisturbed runs agree on it.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use serde_json::Value;

use crate::support::{Ended, files};

/// Files that one run left, with their contents.
pub(crate) type Files = BTreeMap<String, Vec<u8>>;

/// Reads all files of a folder; a missing folder has none.
pub(crate) fn left_in(folder: &Path) -> Files {
    if !folder.is_dir() {
        return Files::new();
    }
    files(folder)
        .into_iter()
        .map(|file| {
            let bytes = fs::read(folder.join(&file)).unwrap();
            (file, bytes)
        })
        .collect()
}

/// Content that every further run has to leave: everything on which several undisturbed runs agree. They differ in
/// times, in memory, and in hashes of files that hold those.
pub(crate) struct ExpectedContent {
    first: Files,
    others: Vec<Files>,
}

impl ExpectedContent {
    /// Keeps at least two `runs`.
    pub(crate) fn of(mut runs: Vec<Files>) -> Self {
        let first = runs.remove(0);
        Self {
            first,
            others: runs,
        }
    }

    /// Returns the faults in the files of another run.
    pub(crate) fn faults(&self, found: &Files) -> Vec<String> {
        let mut faults = Vec::new();
        for name in found.keys().filter(|name| name.contains(".tmp-")) {
            faults.push(format!("{name}: left over"));
        }
        let names: BTreeSet<&String> = self.first.keys().chain(found.keys()).collect();
        for name in names {
            match (self.first.get(name), found.get(name)) {
                _ if is_of_attempt(name) => {}
                (Some(expected), Some(found)) => {
                    let others: Vec<&[u8]> = self
                        .others
                        .iter()
                        .filter_map(|run| run.get(name))
                        .map(Vec::as_slice)
                        .collect();
                    faults.extend(
                        difference(name, expected, &others, found)
                            .map(|what| format!("{name}: {what}")),
                    );
                }
                (Some(_), None) => faults.push(format!("{name}: is missing")),
                _ => faults.push(format!("{name}: is not left by an undisturbed run")),
            }
        }
        faults
    }
}

/// Returns how a file differs from those of undisturbed runs where they agree.
fn difference(name: &str, expected: &[u8], others: &[&[u8]], found: &[u8]) -> Option<String> {
    if others.iter().all(|other| *other == expected) {
        let differs = if shows_times(name) {
            without_numbers(found) != without_numbers(expected)
        } else {
            found != expected
        };
        return differs.then(|| "differs".to_owned());
    }
    let json = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).ok();
    if let Some(expected) = json(expected) {
        let Some(found) = json(found) else {
            return Some("is no JSON".to_owned());
        };
        let (expected, found) = (leaves(&expected), leaves(&found));
        let others: Vec<_> = others
            .iter()
            .filter_map(|bytes| json(bytes))
            .map(|value| leaves(&value))
            .collect();
        let paths: BTreeSet<&String> = expected.keys().chain(found.keys()).collect();
        let differs = |path: &&&String| {
            let is_agreed = others
                .iter()
                .all(|other| other.get(**path) == expected.get(**path));
            is_agreed && !is_measured(path) && found.get(**path) != expected.get(**path)
        };
        return paths
            .iter()
            .find(differs)
            .map(|path| format!("{path} differs"));
    }
    // Tables and plots of times.
    None
}

/// Returns whether a table or a page shows times of results: two runs may agree on it by chance.
fn shows_times(name: &str) -> bool {
    let ending = name.rsplit('.').next().unwrap_or_default();
    matches!(ending, "md" | "tex" | "csv" | "svg" | "html" | "log") && !name.ends_with("frames.csv")
}

/// Returns whether a file records a failed attempt, which stays beside the successful ones.
fn is_of_attempt(name: &str) -> bool {
    name.contains("/attempt-") || name.contains("/failed/")
}

/// Returns a text without its numbers, so that tables of different times are equal.
fn without_numbers(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    text.chars()
        .filter(|letter| !letter.is_ascii_digit() && !".- |:".contains(*letter))
        .collect()
}

/// Returns whether an entry is measured, so that two runs may agree on it by chance.
fn is_measured(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or_default();
    name == "scored_at"
        || name.ends_with("seconds")
        || name.contains("memory")
        || name.contains("wall")
        || matches!(name, "sha256" | "bytes" | "attempt" | "log")
}

/// Returns all values of a JSON document by their paths.
fn leaves(value: &Value) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut open = vec![(String::new(), value)];
    while let Some((path, value)) = open.pop() {
        match value {
            Value::Object(entries) => {
                open.extend(
                    entries
                        .iter()
                        .map(|(name, value)| (format!("{path}/{name}"), value)),
                );
            }
            Value::Array(items) => {
                open.extend(
                    items
                        .iter()
                        .enumerate()
                        .map(|(at, value)| (format!("{path}/{at}"), value)),
                );
            }
            leaf => {
                found.insert(path, leaf.to_string());
            }
        }
    }
    found
}

/// Returns the fault in how a command ended.
pub(crate) fn ending_fault(ended: &Ended) -> Option<String> {
    let Ended { code, stderr, .. } = ended;
    let is_loader = *code == Some(127) && stderr.contains("error while loading shared libraries");
    // The C library allocates for each thread, and GLib for itself; both abort with a line of their own.
    let is_c_library = code.is_none()
        && matches!(stderr.lines().collect::<Vec<_>>()[..], [line]
            if (line.starts_with("Fatal glibc error: ") && line.contains("out of memory"))
                || (line.starts_with("GLib ") && line.contains("Cannot allocate memory")));
    // The encoder of slices reports its own memory itself.
    let ours: Vec<&str> = (stderr.lines())
        .filter(|line| !line.starts_with("x264 [error]: malloc"))
        .collect();
    let is_one_line = matches!(ours[..], [line] if line.starts_with("omnilife: "));
    let is_ours = stderr.contains("mistake of this program");
    let is_right = match code {
        Some(0) => true,
        Some(1 | 2) => is_one_line && !is_ours,
        _ => is_loader || is_c_library,
    };
    (!is_right).then(|| format!("{code:?}: {stderr}"))
}
