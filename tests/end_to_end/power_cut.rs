//! Durability in a power cut: the content of a file is on the disk before it gets its final name, and the folder with
//! the name afterwards. Observed from outside, through `strace`.
//!
//! An ordinary test run watches some of the commands that write; `scripts/reliability power-cut` all.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    support::scratch,
    trial::{Trial, variable},
    writing_commands::Inputs,
};

/// Step in the list of commands where not all are watched.
const EVERY: usize = 12;

/// System call that matters for durability.
#[derive(Debug, PartialEq)]
enum Call {
    Rename(PathBuf, PathBuf),
    Sync(PathBuf),
}

/// Returns the call in a line of `strace -f -y`; `None` for a failed or another one.
fn call(line: &str) -> Option<Call> {
    let (_, call) = line.split_once(char::is_whitespace)?;
    let call = call.trim_start();
    if call.contains(") = -1") {
        return None;
    }
    if call.starts_with("fsync(") || call.starts_with("fdatasync(") {
        let (_, path) = call.split_once('<')?;
        return Some(Call::Sync(path.split_once('>')?.0.into()));
    }
    let mut names = call.split('"').skip(1).step_by(2);
    call.starts_with("rename")
        .then(|| Some(Call::Rename(names.next()?.into(), names.next()?.into())))?
}

/// Returns renames whose content was not on the disk earlier, or whose name was not afterwards.
fn lost(calls: &[Call], folder: &Path) -> Vec<String> {
    let mut lost = Vec::new();
    for (at, call) in calls.iter().enumerate() {
        let Call::Rename(from, to) = call else {
            continue;
        };
        if !to.starts_with(folder) {
            continue;
        }
        let is_synced = |calls: &[Call], path: &Path| {
            calls
                .iter()
                .any(|call| matches!(call, Call::Sync(synced) if synced == path))
        };
        // Files of a folder that is renamed were written one by one.
        let is_file = to.is_file();
        if is_file && !is_synced(&calls[..at], from) && !was_renamed(&calls[..at], from) {
            lost.push(format!("the content of {}", to.display()));
        }
        if !is_synced(&calls[at..], to.parent().unwrap_or(to)) {
            lost.push(format!("the name of {}", to.display()));
        }
    }
    lost
}

/// Returns whether a file was renamed to this name, or a folder to one above it; its content was checked then.
fn was_renamed(calls: &[Call], name: &Path) -> bool {
    calls
        .iter()
        .any(|call| matches!(call, Call::Rename(_, to) if name.starts_with(to)))
}

#[test]
fn every_file_and_its_name_reach_the_disk() {
    let inputs = Inputs::prepare();
    let folder = scratch();
    let trace = folder.path().join("trace");
    let mut wrong = Vec::new();
    let step = variable::<usize>("OMNILIFE_POWER_CUT").map_or(EVERY, |_| 1);
    println!("| command | renames | lost |\n|---|--:|--:|");
    for command in inputs.chosen_commands().iter().step_by(step) {
        let trial = Trial {
            command,
            inputs,
            folder: folder.path().to_owned(),
        };
        trial.reset();
        let file = trace.to_str().unwrap();
        let calls = "trace=rename,renameat,renameat2,fsync,fdatasync";
        let ended = trial.run_through(&[
            "strace",
            "-f",
            "-y",
            "--seccomp-bpf",
            "-s",
            "4096",
            "-e",
            calls,
            "-o",
            file,
        ]);
        let Ok(text) = fs::read_to_string(&trace) else {
            omnilife_schemas::testing::skip("there is no strace that may watch a process");
            return;
        };
        ended.succeeded();
        let calls: Vec<Call> = text.lines().filter_map(call).collect();
        let renames = calls
            .iter()
            .filter(|call| matches!(call, Call::Rename(..)))
            .count();
        let lost = lost(&calls, folder.path());
        println!("| `{}` | {renames} | {} |", command.shown(), lost.len());
        wrong.extend(
            lost.into_iter()
                .map(|what| format!("{}: {what}", command.shown())),
        );
        fs::remove_file(&trace).unwrap();
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn calls_are_told_apart() {
    let rename = call(r#"12 rename("/a/.tmp-x", "/a/x") = 0"#);
    assert_eq!(
        rename,
        Some(Call::Rename("/a/.tmp-x".into(), "/a/x".into()))
    );
    assert_eq!(call("12 fsync(5</a>) = 0"), Some(Call::Sync("/a".into())));
    assert_eq!(call(r#"12 rename("/a", "/b") = -1 ENOENT"#), None);
    let whole = [
        "1 fsync(3</a/.t>) = 0",
        r#"1 rename("/a/.t", "/a/t") = 0"#,
        "1 fsync(4</a>) = 0",
    ];
    let calls: Vec<Call> = whole.iter().filter_map(|line| call(line)).collect();
    assert!(lost(&calls, Path::new("/a")).is_empty());
    assert_eq!(lost(&calls[1..2], Path::new("/a")), ["the name of /a/t"]);
}
