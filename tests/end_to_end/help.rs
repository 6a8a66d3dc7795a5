//! Help and version of the binary, and help of the scripts.

use std::{fs, path::Path, process::Command};

use crate::support::omnilife;

fn said(arguments: &[&str]) -> String {
    let ended = omnilife(arguments).succeeded();
    assert_eq!(ended.stderr, "");
    ended.stdout
}

#[test]
fn help() {
    insta::assert_snapshot!("help", said(&["--help"]));
}

#[test]
fn help_of_run() {
    insta::assert_snapshot!("help-run", said(&["run", "--help"]));
}

#[test]
fn list_of_protocols_and_metrics() {
    insta::assert_snapshot!("bench-list", said(&["bench", "list"]));
}

#[test]
fn lists_for_programs() {
    for (words, ids) in [
        (["bench", "list", "--json"], "/protocols/0/id"),
        (["bench", "list", "--json"], "/metrics/0/direction"),
        (["reconstruct", "methods", "--json"], "/0/id"),
    ] {
        let list: serde_json::Value = serde_json::from_str(&said(&words)).unwrap();
        assert!(
            list.pointer(ids).is_some_and(serde_json::Value::is_string),
            "{words:?} {ids}: {list}"
        );
    }
}

#[test]
fn the_version_has_the_commit() {
    let version = said(&["-V"]);
    assert!(
        version.starts_with(concat!("omnilife ", env!("CARGO_PKG_VERSION"))),
        "{version}"
    );
    let report = omnilife(["doctor", "--json"]).stdout;
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    let commit = report["commit"].as_str().unwrap_or_default();
    let digits = commit.split('-').next().unwrap_or_default();
    let digits: String = digits.chars().take(12).collect();
    let is_known = digits.chars().all(|digit| digit.is_ascii_hexdigit());
    assert!(
        !is_known || version.contains(&digits),
        "{version}: {commit}"
    );
}

#[test]
fn list_of_methods() {
    insta::assert_snapshot!("reconstruct-methods", said(&["reconstruct", "methods"]));
}

#[test]
fn every_bash_script_shows_its_help() {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts")];
    let mut scripts = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if !fs::read(&path)
                .unwrap()
                .starts_with(b"#!/usr/bin/env bash\n")
            {
                continue;
            }
            scripts += 1;
            let ended = Command::new(&path).arg("--help").output().unwrap();
            let (help, errors) = (
                String::from_utf8_lossy(&ended.stdout),
                String::from_utf8_lossy(&ended.stderr),
            );
            assert_eq!(ended.status.code(), Some(0), "{}: {errors}", path.display());
            assert!(
                help.lines().count() >= 3 && errors.is_empty(),
                "{}: {help}{errors}",
                path.display()
            );
        }
    }
    assert!(scripts > 20, "{scripts} scripts");
}
