//! Benchmark from scenes, protocols and methods to tables (`bench run`): two runs have the same scores.

use std::{ffi::OsStr, fs, path::Path};

use omnilife_schemas::{
    records::{ResultRecord, Scene},
    store,
};

use crate::support::{self, SEQUENCE, copy_of_small_run, omnilife, scratch, small_run};

/// Stand-in for an external method: it copies the image of an input view to every novel view.
const COPIER: &str = r#"
id = "copier"
[render]
command = ["sh", "{folder}/copy.sh", "{scene}", "{work}"]
[predictions]
novel = "{work}/{index}.png"
"#;

fn bench_run(methods: &str, out: &Path) -> support::Ended {
    bench_run_with(methods, out, &[])
}

fn bench_run_with(methods: &str, out: &Path, options: &[&OsStr]) -> support::Ended {
    let scene = small_run().out.join(SEQUENCE);
    let mut arguments: Vec<&OsStr> = vec!["bench".as_ref(), "run".as_ref()];
    arguments.extend([scene.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    let further = ["--methods", methods, "--iterations", "10"];
    arguments.extend(further.iter().map(OsStr::new));
    arguments.extend(options);
    omnilife(arguments)
}

/// Returns all scores below a folder with the paths of their results.
fn scores(out: &Path) -> Vec<(String, ResultRecord)> {
    support::files(out)
        .into_iter()
        .filter(|file| file.ends_with("result.json"))
        .map(|file| {
            let mut result: ResultRecord = store::read_record(&out.join(&file)).unwrap();
            // Values that depend on the moment.
            result.training_seconds = None;
            result.rendering_seconds = None;
            result.peak_memory_bytes = None;
            result.stages.clear();
            (file, result)
        })
        .collect()
}

#[test]
fn two_runs_of_a_benchmark_have_the_same_scores() {
    let folder = scratch();
    let manifest = folder.path().join("method.toml");
    fs::write(&manifest, COPIER).unwrap();
    let script =
        "for i in 0 1 2 3 4 5 6 7; do cp \"${1%/*}/frames/000000.png\" \"$2/$i.png\"; done";
    fs::write(folder.path().join("copy.sh"), script).unwrap();
    let methods = format!("odgs,sphere-sweep,nearest-input,{}", manifest.display());
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    let ended = bench_run(&methods, &first).succeeded();
    assert!(ended.stdout.contains("| sphere-sweep"), "{}", ended.stdout);
    let events = folder.path().join("events");
    bench_run_with(
        &methods,
        &second,
        &["--tensorboard".as_ref(), events.as_os_str()],
    )
    .succeeded();
    // One training per protocol, each with a file of its own.
    let event_files = support::files(&events);
    assert_eq!(event_files.len(), 2, "{event_files:?}");
    for (file, protocol) in event_files
        .iter()
        .zip(["per-scene", "sparse-interpolation"])
    {
        let is_named = file.contains(&format!(".{protocol}.odgs.seed-0/events.out.tfevents."));
        assert!(is_named, "{file}");
    }
    let scores_of_first = scores(&first);
    // Four methods under two protocols.
    assert_eq!(scores_of_first.len(), 8);
    assert_eq!(scores_of_first, scores(&second));
    for (file, result) in &scores_of_first {
        let views = if file.contains("sparse-interpolation") {
            8
        } else {
            2
        };
        assert_eq!(result.novel_views["psnr"].views, views, "{file}");
        assert!(result.failures.is_empty());
    }
    let tables = first.join("leaderboard/tables");
    assert_eq!(fs::read_dir(tables).unwrap().count(), 2);
    let outcomes = fs::read_to_string(first.join("outcomes.csv")).unwrap();
    assert_eq!(outcomes.matches(",scored,").count(), 8);
}

#[test]
fn a_method_that_fails_is_a_row_and_the_others_go_on() {
    let folder = scratch();
    let manifest = folder.path().join("method.toml");
    fs::write(&manifest, COPIER).unwrap();
    fs::write(folder.path().join("copy.sh"), "echo no weights >&2; exit 3").unwrap();
    let out = folder.path().join("out");
    let methods = format!("nearest-input,{}", manifest.display());
    let ended = bench_run(&methods, &out);
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(ended.stdout.contains("nearest-input"));
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    assert_eq!(
        outcomes.matches("copier,0,failed,").count(),
        2,
        "{outcomes}"
    );
    let results = scores(&out);
    let failed = results
        .iter()
        .find(|(file, _)| file.contains("sparse-interpolation/copier"));
    let reason = failed.unwrap().1.run_failure.clone();
    assert!(reason.is_some_and(|reason| reason.contains("no weights")));
}

#[test]
fn methods_and_scenes_that_do_not_exist_are_refused_at_once() {
    let folder = scratch();
    let out = folder.path().join("out");
    for (methods, expected) in [
        ("nerf", "there is no method \"nerf\""),
        ("odgs,odgs", "method odgs is given twice"),
        ("missing.toml", "missing.toml"),
    ] {
        let ended = bench_run(methods, &out);
        assert_eq!(ended.code, Some(2));
        assert!(ended.stderr.contains(expected), "{}", ended.stderr);
        assert!(!out.exists());
    }
}

/// The sample's first nine frames are too few for the groups of ten of `sparse-interpolation`.
#[test]
fn a_scene_that_is_too_short_for_a_protocol_is_left_out_unless_the_protocol_is_named() {
    let copy = copy_of_small_run();
    let sequence = copy.path().join(SEQUENCE);
    let file = sequence.join("scene.json");
    let mut scene: Scene = store::read_record(&file).unwrap();
    scene.frames.truncate(9);
    store::write_record(&file, &scene).unwrap();
    let bench = |out: &Path, further: &[&str]| {
        let words = ["bench", "run", "--methods", "nearest-input"];
        let words = words.into_iter().chain(further.iter().copied());
        let words = words.map(OsStr::new).chain([sequence.as_os_str()]);
        omnilife(words.chain(["--out".as_ref(), out.as_os_str()]))
    };
    let out = copy.path().join("bench");
    let ended = bench(&out, &[]).succeeded();
    let notes = ended
        .stderr
        .matches("sparse-interpolation is left out")
        .count();
    assert_eq!(notes, 1, "{}", ended.stderr);
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    let left_out = format!("{},sparse-interpolation,,,left out,", scene.id);
    assert_eq!(outcomes.matches(&left_out).count(), 1, "{outcomes}");
    assert_eq!(outcomes.matches(",scored,").count(), 1, "{outcomes}");
    assert_eq!(outcomes.lines().count(), 3, "{outcomes}");
    // Named, it is refused before anything is written.
    let out = copy.path().join("named");
    let ended = bench(&out, &["--quiet", "--protocols", "sparse-interpolation"]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("9 frames"), "{message}");
    assert!(!out.exists());
}
