//! Asks git which commit the program is built from, for the provenance of its records.
//!
//! `OMNILIFE_COMMIT` holds 40 hexadecimal digits, followed by `-changed` where tracked files differ
//! from that commit, and nothing where there is no git repository of this project, as in a release
//! archive. Whoever packages such an archive may set `OMNILIFE_COMMIT` themselves.

use std::{path::Path, process::Command};

/// Where a change makes another program.
const SOURCES: [&str; 10] = [
    "Cargo.toml",
    "Cargo.lock",
    "src",
    "schemas/src",
    "networks/src",
    "curate/src",
    "reconstruct/src",
    "bench/src",
    "leaderboard/src",
    "sweep/src",
];

fn main() {
    println!("cargo::rerun-if-env-changed=OMNILIFE_COMMIT");
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
    }
    // Grows with every commit and checkout; a file that is not there would make every build a new
    // one.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"])
        && Path::new(&log).exists()
    {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = std::env::var("OMNILIFE_COMMIT")
        .ok()
        .or_else(commit)
        .unwrap_or_default();
    println!("cargo::rustc-env=OMNILIFE_COMMIT={commit}");
}

fn commit() -> Option<String> {
    // Not that of a repository into which an archive was unpacked.
    let top = git(&["rev-parse", "--show-toplevel"])?;
    let here = std::env::var("CARGO_MANIFEST_DIR").ok()?;
    if Path::new(&top).canonicalize().ok()? != Path::new(&here).canonicalize().ok()? {
        return None;
    }
    let commit = git(&["rev-parse", "HEAD"])?;
    let changes = git(&["status", "--porcelain", "--untracked-files=no"])?;
    let changed = if changes.is_empty() { "" } else { "-changed" };
    Some(format!("{commit}{changed}"))
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
