//! Direction of dependencies: `base` <- `schemas`; {`schemas`, `stereo`, `charts`} <- {`networks`, `engine`, `video`}
//! <- `tracks` <- {`curate`, `reconstruct`, `bench`, `leaderboard`, `sweep`} <- {the binary, `python`}. There are no
//! sideways edges.
//!
//! `base` is for `schemas`, which exports its modules, `networks` for the crates that run networks, `engine` for the
//! crates below `reconstruct/`, `video` for `tracks` and `curate`. `tracks` is for the binary and the tests of
//! `curate`, `stereo` for the crates that match images, `charts` for those that draw, `results` for `leaderboard`, so
//! that Polars is nowhere else. All have `features`, which has no code.
//!
//! Below `reconstruct/`: `engine` <- `training` <- {`methods`, `atlas`} <- `reconstruct` <- `stability`, so that an
//! edit of a method compiles neither the training nor the other crate of methods again.

use std::{
    collections::{BTreeMap, BTreeSet},
    process::Command,
};

use serde_json::Value;

const FEATURES: &str = "omnilife-features";
const BASE: &str = "omnilife-base";
const SCHEMAS: &str = "omnilife-schemas";
const NETWORKS: &str = "omnilife-networks";
const STEREO: &str = "omnilife-stereo";
const CHARTS: &str = "omnilife-charts";
const ENGINE: &str = "omnilife-engine";
const TRAINING: &str = "omnilife-training";
const METHODS: &str = "omnilife-methods";
const ATLAS: &str = "omnilife-atlas";
const RECONSTRUCT: &str = "omnilife-reconstruct";
const STABILITY: &str = "omnilife-stability";
const VIDEO: &str = "omnilife-video";
const TRACKS: &str = "omnilife-tracks";
const RESULTS: &str = "omnilife-results";
const BINARY: &str = "omnilife";
const PYTHON: &str = "omnilife-python";
const CRATES: [&str; 5] = [
    "omnilife-bench",
    "omnilife-curate",
    "omnilife-leaderboard",
    RECONSTRUCT,
    "omnilife-sweep",
];

/// Returns the direct dependencies of every workspace member, including those of tests and build scripts.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version=1"])
        .args([
            "--manifest-path",
            concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"),
        ])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let name = |value: &Value| value["name"].as_str().unwrap().to_owned();
    metadata["packages"]
        .as_array()
        .unwrap()
        .iter()
        .map(|package| {
            let dependencies = package["dependencies"].as_array().unwrap();
            (name(package), dependencies.iter().map(name).collect())
        })
        .collect()
}

fn ours(dependencies: &BTreeSet<String>) -> BTreeSet<&str> {
    dependencies
        .iter()
        .map(String::as_str)
        .filter(|name| name.starts_with(BINARY) && *name != FEATURES)
        .collect()
}

#[test]
fn every_member_has_its_place() {
    let mut known = BTreeSet::from(CRATES);
    known.extend([
        BASE, SCHEMAS, NETWORKS, STEREO, CHARTS, ENGINE, TRAINING, METHODS, ATLAS, STABILITY,
        VIDEO, TRACKS, RESULTS, BINARY, PYTHON, FEATURES,
    ]);
    let dependencies = dependencies();
    let members: BTreeSet<_> = dependencies.keys().map(String::as_str).collect();
    assert_eq!(members, known, "a new crate needs its edges in this test");
}

/// A crate without them compiles its dependencies once more where it is built alone.
#[test]
fn every_member_has_the_shared_features() {
    for (name, dependencies) in dependencies() {
        assert_eq!(
            dependencies.contains(FEATURES),
            name != FEATURES,
            "{name}: cargo hakari manage-deps adds it"
        );
    }
}

#[test]
fn what_all_share_depends_on_no_sibling() {
    let dependencies = dependencies();
    for name in [BASE, STEREO, CHARTS] {
        assert_eq!(ours(&dependencies[name]), BTreeSet::new(), "{name}");
    }
    assert_eq!(ours(&dependencies[SCHEMAS]), BTreeSet::from([BASE]));
}

#[test]
fn crates_depend_on_what_they_share_alone() {
    let dependencies = dependencies();
    for name in [NETWORKS, ENGINE, VIDEO, RESULTS] {
        assert_eq!(
            ours(&dependencies[name]),
            BTreeSet::from([SCHEMAS]),
            "{name}"
        );
    }
    assert_eq!(
        ours(&dependencies[TRACKS]),
        BTreeSet::from([SCHEMAS, NETWORKS, STEREO, VIDEO])
    );
    for name in CRATES {
        let expected = match name {
            "omnilife-curate" => BTreeSet::from([SCHEMAS, CHARTS, NETWORKS, VIDEO, TRACKS]),
            "omnilife-bench" => BTreeSet::from([SCHEMAS, CHARTS, NETWORKS]),
            // Its tests run the numerical cases.
            RECONSTRUCT => BTreeSet::from([SCHEMAS, ENGINE, TRAINING, METHODS, ATLAS, STABILITY]),
            "omnilife-leaderboard" => BTreeSet::from([SCHEMAS, CHARTS, RESULTS]),
            _ => BTreeSet::from([SCHEMAS]),
        };
        assert_eq!(ours(&dependencies[name]), expected, "{name}");
    }
}

#[test]
fn the_crates_of_reconstruction_stand_on_each_other() {
    let dependencies = dependencies();
    for (name, below) in [
        (TRAINING, BTreeSet::from([SCHEMAS, CHARTS, ENGINE, STEREO])),
        (METHODS, BTreeSet::from([SCHEMAS, ENGINE, TRAINING])),
        (ATLAS, BTreeSet::from([SCHEMAS, ENGINE, TRAINING])),
        (
            STABILITY,
            BTreeSet::from([SCHEMAS, ENGINE, TRAINING, METHODS, ATLAS, RECONSTRUCT]),
        ),
    ] {
        assert_eq!(ours(&dependencies[name]), below, "{name}");
    }
}

#[test]
fn the_binary_depends_on_all() {
    let mut expected = BTreeSet::from(CRATES);
    expected.extend([SCHEMAS, ENGINE, STABILITY, VIDEO, TRACKS]);
    assert_eq!(ours(&dependencies()[BINARY]), expected);
}

/// Python's process must not load FFmpeg, OpenCV or a GPU's libraries.
#[test]
fn the_module_for_python_reads_and_scores_alone() {
    let expected = BTreeSet::from([SCHEMAS, "omnilife-bench", "omnilife-leaderboard"]);
    assert_eq!(ours(&dependencies()[PYTHON]), expected);
}

#[test]
fn scores_and_tables_need_no_graphics() {
    let dependencies = dependencies();
    for name in [
        "omnilife-bench",
        "omnilife-leaderboard",
        "omnilife-sweep",
        BASE,
        SCHEMAS,
    ] {
        for graphics in ["wgpu", "pollster", "naga"] {
            assert!(
                !dependencies[name].contains(graphics),
                "{name} depends on {graphics}"
            );
        }
    }
    assert!(
        !dependencies["omnilife-leaderboard"].contains("image"),
        "the leaderboard reads results, never images"
    );
    assert!(
        !dependencies[BASE].contains("image"),
        "images are read in {SCHEMAS}"
    );
}

/// Chosen foundations of the project, each with the crate that uses it.
#[test]
fn packages_that_the_project_is_built_on_are_used() {
    let dependencies = dependencies();
    for (package, user) in [
        ("ffmpeg-next", VIDEO),
        ("opencv", "omnilife-curate"),
        ("serde", SCHEMAS),
        ("csv", "omnilife-leaderboard"),
        ("rayon", ENGINE),
        ("image", SCHEMAS),
        ("glam", ENGINE),
        ("polars", RESULTS),
        ("plotters", CHARTS),
        ("indicatif", BINARY),
        ("clap", BINARY),
    ] {
        assert!(
            dependencies[user].contains(package),
            "{user} lost {package}"
        );
    }
}
