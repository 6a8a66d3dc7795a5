//! Asks git which commit the program is built from, for the provenance of its records. The module for
//! Python is built by this script too.
//!
//! `OMNILIFE_COMMIT` holds 40 hexadecimal digits, followed by `-changed` where tracked files differ
//! from that commit, and nothing where there is no git repository of this project, as in a release
//! archive. Whoever packages such an archive may set `OMNILIFE_COMMIT` themselves.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Sources of the program, below the root of the workspace: a change in one of them makes another program.
const SOURCES: [&str; 21] = [
    "Cargo.toml",
    "Cargo.lock",
    "src",
    "schemas/base/src",
    "schemas/src",
    "charts/src",
    "networks/src",
    "stereo/src",
    "curate/video/src",
    "curate/tracks/src",
    "curate/src",
    "reconstruct/engine/src",
    "reconstruct/training/src",
    "reconstruct/methods/src",
    "reconstruct/atlas/src",
    "reconstruct/src",
    "reconstruct/stability/src",
    "bench/src",
    "leaderboard/results/src",
    "leaderboard/src",
    "sweep/src",
];

fn main() {
    println!("cargo::rerun-if-env-changed=OMNILIFE_COMMIT");
    if let Some(root) = root() {
        for source in SOURCES {
            println!("cargo::rerun-if-changed={}", root.join(source).display());
        }
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
    println!("cargo::rustc-env=OMNILIFE_VERSION={}", version(&commit));
}

/// The version for people: with the first digits of the commit, where there is one.
fn version(commit: &str) -> String {
    const DIGITS: usize = 12;
    let version = std::env::var("CARGO_PKG_VERSION").unwrap_or_default();
    match commit.split_once('-') {
        None if commit.is_empty() => version,
        None => format!("{version} ({commit:.DIGITS$})"),
        Some((hash, change)) => format!("{version} ({hash:.DIGITS$}, {change})"),
    }
}

/// The root of the workspace, which alone has a lock file.
fn root() -> Option<PathBuf> {
    let package = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR")?);
    let mut folders = package.ancestors();
    let root = folders.find(|folder| folder.join("Cargo.lock").exists())?;
    Some(root.to_owned())
}

fn commit() -> Option<String> {
    // Not that of a repository into which an archive was unpacked.
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if Path::new(&top).canonicalize().ok()? != root()?.canonicalize().ok()? {
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
