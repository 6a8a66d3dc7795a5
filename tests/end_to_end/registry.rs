//! Every row of the list of methods, through every command that takes a method.

use std::fs;

use omnilife_reconstruct::methods::METHODS;

use crate::support::{SEQUENCE, omnilife, scratch, small_run};

/// A method that needs something which a benchmark does not make is found here.
#[test]
fn every_method_can_be_benchmarked() {
    let sequence = small_run().out.join(SEQUENCE);
    let folder = scratch();
    let out = folder.path().join("bench");
    let ids: Vec<&str> = METHODS.iter().map(|method| method.id).collect();
    let ended = omnilife([
        "bench",
        "run",
        sequence.to_str().unwrap(),
        "--methods",
        &ids.join(","),
        "--protocols",
        "per-scene",
        "--iterations",
        "4",
        "--out",
        out.to_str().unwrap(),
    ]);
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    for id in ids {
        let mut lines = outcomes.lines();
        let line = lines
            .find(|line| line.contains(&format!(",{id},")))
            .unwrap();
        assert!(line.contains(",scored,"), "{line}\n{}", ended.stderr);
    }
    ended.succeeded();
}
