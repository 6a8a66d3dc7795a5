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
fn list_of_methods() {
    insta::assert_snapshot!("reconstruct-methods", said(&["reconstruct", "methods"]));
}
