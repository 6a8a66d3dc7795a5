//! Two processes that write into one folder.

use std::{
    fs,
    process::{Command, Output, Stdio},
};

use assert_cmd::cargo::cargo_bin;

use crate::support::{SMALL, assert_all_whole, result, sample, scratch};

#[test]
fn the_second_run_into_a_folder_is_refused_in_one_line() {
    let folder = scratch();
    let out = folder.path().join("out");
    let start = |width: &str| {
        Command::new(cargo_bin!("omnilife"))
            .args(["--quiet", "run"])
            .args([sample("street.mp4"), "--poses".into(), sample("poses.json")])
            .args(SMALL)
            .args(["--width", width, "--out"])
            .arg(&out)
            .env("OMNILIFE_DATA", "/nonexistent")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let runs = ["128", "64"].map(start);
    let ids = runs.each_ref().map(std::process::Child::id);
    let ended: Vec<Output> = runs
        .into_iter()
        .map(|run| run.wait_with_output().unwrap())
        .collect();
    let codes: Vec<_> = ended.iter().map(|ended| ended.status.code()).collect();
    let first = codes.iter().position(|code| *code == Some(0)).unwrap();
    let (winner, loser) = (&ended[first], &ended[1 - first]);
    let message = String::from_utf8_lossy(&loser.stderr);
    assert_eq!(codes[1 - first], Some(2), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    let holder = format!("is being written by process {} on ", ids[first]);
    assert!(
        message.contains(&holder) && message.contains(" since "),
        "{message}"
    );
    assert!(loser.stdout.is_empty());
    assert_all_whole(&out);
    assert!(result(&out).failures.is_empty());
    let table = fs::read_to_string(out.join("table.md")).unwrap();
    assert!(String::from_utf8_lossy(&winner.stdout).starts_with(&table));
    assert!(!out.join(".omnilife.lock").exists());
}
