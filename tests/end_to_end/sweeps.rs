//! Sweeps of curation and of the benchmark: their units leave the same files as the commands for one machine.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{Dataset, ResultRecord},
    store,
};

use crate::support::{Ended, SEQUENCE, omnilife, sample, scratch, small_run};

/// Runs `omnilife sweep <command> SWEEP <options>`.
fn sweep(command: &str, folder: &Path, options: &[&str]) -> Ended {
    let mut arguments = vec!["--quiet", "sweep", command, folder.to_str().unwrap()];
    arguments.extend(options);
    omnilife(arguments)
}

fn plan(arguments: &[&str]) -> Ended {
    let mut all = vec!["--quiet", "sweep", "plan"];
    all.extend(arguments);
    omnilife(all)
}

#[test]
fn videos_one_by_one_give_the_dataset_of_all_at_once() {
    let folder = scratch();
    let videos = folder.path().join("videos");
    fs::create_dir(&videos).unwrap();
    fs::copy(sample("street.mp4"), videos.join("street.mp4")).unwrap();
    fs::write(videos.join("broken.mp4"), "no video").unwrap();
    let options = ["--criteria", "none", "--max-frames", "4", "--width", "64"];
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let mut at_once = vec!["--quiet", "curate", videos.to_str().unwrap(), "--out"];
    at_once.push(whole.to_str().unwrap());
    at_once.extend(options);
    assert_eq!(omnilife(at_once).code, Some(2), "one video is broken");

    let work = folder.path().join("sweep");
    let mut arguments = vec!["curate", videos.to_str().unwrap(), "--dataset"];
    arguments.extend([parts.to_str().unwrap(), "--out", work.to_str().unwrap()]);
    arguments.extend(options);
    plan(&arguments).succeeded();
    let ran = sweep("run", &work, &[]);
    let message = ran.failed_quietly(2);
    assert!(
        message.starts_with("1 of 2 units failed, the first: broken: "),
        "{message}"
    );
    // The broken video is a row of the dataset, and fails the command that builds it.
    let reduced = sweep("reduce", &work, &[]);
    assert!(
        reduced.failed_quietly(1).contains("broken.mp4"),
        "{}",
        reduced.stderr
    );
    let datasets = [&whole, &parts]
        .map(|out| -> Dataset { store::read_record(&out.join("dataset.json")).unwrap() });
    assert_eq!(datasets[0], datasets[1]);
    let files = [&whole, &parts].map(|out| crate::support::files(out));
    assert_eq!(files[0], files[1]);
}

#[test]
fn options_of_a_training_need_a_method_that_is_trained() {
    let folder = scratch();
    let scene: PathBuf = small_run().out.join(SEQUENCE);
    let [results, work] = ["results", "sweep"].map(|name| folder.path().join(name));
    let mut arguments = vec!["bench", scene.to_str().unwrap(), "--methods", "cross-fade"];
    arguments.extend(["--results", results.to_str().unwrap()]);
    arguments.extend(["--out", work.to_str().unwrap(), "--", "--iterations", "3"]);
    let refused = plan(&arguments);
    assert!(
        refused
            .failed_quietly(2)
            .contains("none of the methods is trained"),
        "{}",
        refused.stderr
    );
}

#[test]
fn units_of_one_sweep_have_event_files_of_their_own() {
    let folder = scratch();
    let scene: PathBuf = small_run().out.join(SEQUENCE);
    let [results, events] = ["results", "events"].map(|name| folder.path().join(name));
    let planned = |work: &str, options: &[&str]| {
        let work = folder.path().join(work);
        let mut arguments = vec!["bench", scene.to_str().unwrap(), "--methods", "odgs"];
        arguments.extend(["--seeds", "0,1", "--results", results.to_str().unwrap()]);
        arguments.extend(["--out", work.to_str().unwrap(), "--"]);
        (plan(&[&arguments[..], options].concat()), work)
    };
    let option = format!("--tensorboard={}", events.display());
    let option = option.as_str();
    for options in [&["--tensorboard"][..], &[option, option]] {
        let (refused, _) = planned("refused", options);
        assert!(
            refused.failed_quietly(2).contains("--tensorboard"),
            "{}",
            refused.stderr
        );
    }
    let words = [
        "--iterations",
        "3",
        "--tensorboard",
        events.to_str().unwrap(),
    ];
    let other_way = [option, "--iterations", "3"];
    for (work, options) in [("first", &words[..]), ("second", &other_way)] {
        let (ended, work) = planned(work, options);
        ended.succeeded();
        let units = fs::read_to_string(work.join("plan.json")).unwrap();
        for seed in [0, 1] {
            let own = format!("/events/street-seq-000.per-scene.odgs.seed-{seed}\"");
            assert_eq!(units.matches(&own).count(), 1, "{units}");
        }
        assert_eq!(units.matches("--tensorboard").count(), 2, "{units}");
    }
}

#[test]
fn methods_scenes_and_seeds_become_one_table() {
    let folder = scratch();
    let results = folder.path().join("results");
    let work = folder.path().join("sweep");
    let method = folder.path().join("method.toml");
    // An external method that fails.
    fs::write(
        &method,
        "id = \"mine\"\n[render]\ncommand = [\"sh\", \"-c\", \"echo no GPU; exit 3\"]\n\
         [predictions]\nnovel = \"{work}/{frame:06}.png\"\n",
    )
    .unwrap();
    let scene: PathBuf = small_run().out.join(SEQUENCE);
    let methods = format!("odgs,sphere-sweep,nearest-input,{}", method.display());
    let mut arguments = vec!["bench", scene.to_str().unwrap(), "--methods", &methods];
    arguments.extend(["--seeds", "0,1", "--results", results.to_str().unwrap()]);
    arguments.extend(["--out", work.to_str().unwrap()]);
    let refused = plan(&[&arguments[..], &["--", "--iterations", "many"]].concat());
    assert!(
        refused.failed_quietly(2).contains("many"),
        "{}",
        refused.stderr
    );
    assert!(!work.exists());
    let planned = plan(&[&arguments[..], &["--", "--iterations", "3"]].concat()).succeeded();
    // Methods without training have no seeds.
    assert!(
        planned.stdout.ends_with("plan.json: 6 units\n"),
        "{}",
        planned.stdout
    );

    // A method that fails is a failed unit, and a row of failures.
    let ran = sweep("run", &work, &["--cores", "2"]);
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    sweep("reduce", &work, &[]).succeeded();
    let record = |method: &str, seed: u32| -> ResultRecord {
        let file = format!("street/seq-000/per-scene/{method}/seed-{seed}/score/result.json");
        store::read_record(&results.join(file)).unwrap()
    };
    assert_eq!(record("odgs", 1).seed, Some(1));
    assert!(record("odgs", 0).failures.is_empty());
    let mine = record("mine", 0);
    assert!(
        mine.run_failure
            .is_some_and(|reason| reason.contains("no GPU"))
    );
    let novel = mine
        .failures
        .iter()
        .filter(|failure| failure.view == "novel");
    assert_eq!(novel.count(), 2);
    for method in ["sphere-sweep", "nearest-input"] {
        assert!(record(method, 0).failures.is_empty(), "{method}");
    }
    let table = fs::read_to_string(results.join("leaderboard/table.md")).unwrap();
    assert!(
        table.contains("| odgs ") && table.contains("| mine †"),
        "{table}"
    );

    // A unit that itself fails becomes a row of failures too, and a result once it succeeds.
    let other = folder.path().join("other");
    let out = folder.path().join("other-results");
    let mut arguments = vec!["bench", scene.to_str().unwrap(), "--methods", "odgs"];
    arguments.extend([
        "--results",
        out.to_str().unwrap(),
        "--out",
        other.to_str().unwrap(),
    ]);
    arguments.extend(["--unit-limit", "0.2", "--", "--iterations", "100000"]);
    plan(&arguments).succeeded();
    let message = sweep("run", &other, &[]).failed_quietly(1).to_owned();
    assert!(message.contains("ended at its time limit"), "{message}");
    sweep("reduce", &other, &[]).succeeded();
    let file = out.join("street/seq-000/per-scene/odgs/seed-0/score/result.json");
    let failed: ResultRecord = store::read_record(&file).unwrap();
    assert_eq!(failed.failures.len(), 10);
    let reason = failed.run_failure.unwrap();
    assert!(reason.contains("ended at its time limit"), "{reason}");
}
