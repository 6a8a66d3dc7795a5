//! Help and version of the binary.

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
