//! Runs that failed, hung or wrote other files than views. A benchmark with them ends with the exit code of bad
//! input, and outcomes, ranks, tables and site agree on it.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{ExternalRun, ResultRecord},
    store,
};
use tempfile::TempDir;

use crate::support::{METHOD, SEQUENCE, copy_of_small_run, files, omnilife, scratch, small_run};

/// Copies true frames to the folder of novel views, as a trainer does that tests itself early.
const LEAVES_VIEWS: &str =
    "for i in 4 9; do cp \"${1%/*}/frames/00000$i.png\" \"$2/00000$i.png\"; done";

/// Writes a `method.toml` whose training runs `train` and whose rendering runs `render`.
fn method(folder: &Path, id: &str, head: &str, train: &str, render: &str) -> PathBuf {
    let place = folder.join(id);
    fs::create_dir_all(&place).unwrap();
    fs::write(place.join("train.sh"), train).unwrap();
    fs::write(place.join("render.sh"), render).unwrap();
    let manifest = place.join("method.toml");
    let text = format!(
        "id = \"{id}\"\n{head}\n[train]\ncommand = [\"sh\", \"{{folder}}/train.sh\", \"{{scene}}\", \"{{work}}\"]\n\
         [render]\ncommand = [\"sh\", \"{{folder}}/render.sh\", \"{{scene}}\", \"{{work}}\"]\n\
         [predictions]\nnovel = \"{{work}}/{{frame:06}}.png\"\n"
    );
    fs::write(&manifest, text).unwrap();
    manifest
}

struct Benchmark {
    folder: TempDir,
    code: Option<i32>,
    stderr: String,
}

impl Benchmark {
    /// Makes one good method of ours and three external ones that end badly with views in their folders.
    fn new() -> Self {
        let folder = scratch();
        let at = |id: &str, head: &str, train: &str, render: &str| {
            let manifest = method(folder.path(), id, head, train, render);
            manifest.to_str().unwrap().to_owned()
        };
        let crash = format!("{LEAVES_VIEWS}\necho out of memory >&2\nexit 137");
        let hang = format!("{LEAVES_VIEWS}\nsleep 600");
        let garbage = "for i in 4 9; do echo no image > \"$2/00000$i.png\"; done";
        let methods = [
            "nearest-input".to_owned(),
            at("crashes", "", &crash, "false"),
            at("hangs", "time_limit_seconds = 1.5", &hang, "false"),
            at("garbage", "", "true", garbage),
        ];
        let sequence = small_run().out.join(SEQUENCE);
        let out = folder.path().join("bench");
        let ended = omnilife([
            "bench",
            "run",
            sequence.to_str().unwrap(),
            "--methods",
            &methods.join(","),
            "--protocols",
            "per-scene",
            "--out",
            out.to_str().unwrap(),
        ]);
        Self {
            folder,
            code: ended.code,
            stderr: ended.stderr,
        }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join("bench").join(name)
    }

    fn result(&self, method: &str) -> ResultRecord {
        let file = format!("scenes/street/seq-000/per-scene/{method}/seed-0/score/result.json");
        store::read_record(&self.at(&file)).unwrap()
    }
}

#[test]
fn what_ended_badly_is_never_ranked_and_everything_says_so() {
    let bench = Benchmark::new();
    assert_eq!(bench.code, Some(2), "{}", bench.stderr);
    let outcomes = fs::read_to_string(bench.at("outcomes.csv")).unwrap();
    for (id, outcome, reason) in [
        ("nearest-input", "scored", ""),
        ("crashes", "failed", "out of memory"),
        ("hangs", "failed", "time limit of 1.5 s"),
        ("garbage", "incomplete", "not a usable PNG"),
    ] {
        let mut lines = outcomes.lines();
        let line = lines
            .find(|line| line.contains(&format!(",{id},")))
            .unwrap();
        let expected = format!(",{outcome},");
        assert!(line.contains(&expected) && line.contains(reason), "{line}");
        let result = bench.result(id);
        assert_eq!(result.is_complete(), outcome == "scored", "{id}");
        assert_eq!(result.run_failure.is_some(), outcome == "failed", "{id}");
        if outcome == "failed" {
            let novel = result.failures.iter().filter(|view| view.view == "novel");
            assert_eq!(novel.count(), 2, "{id}");
            assert!(result.novel_views.is_empty() && result.input_views.is_empty());
            assert_eq!(result.training_seconds, None);
            assert!(result.run_failure.unwrap().contains(reason));
        }
    }
    // In every format, a method without scores has neither a number nor the mark of a best one.
    let tables = files(&bench.at("leaderboard"));
    let of_format = |ending: &str| tables.iter().any(|file| file.ends_with(ending));
    assert!([".md", ".tex", ".csv", ".html"].into_iter().all(of_format));
    for file in tables
        .iter()
        .filter(|file| file.ends_with(".md") || file.ends_with(".tex"))
    {
        let text = fs::read_to_string(bench.at("leaderboard").join(file)).unwrap();
        for line in text
            .lines()
            .filter(|line| line.contains('|') || line.contains('&'))
        {
            if ["crashes", "hangs"].iter().any(|id| line.contains(id)) {
                let marked = line.contains("**") || line.contains("\\textbf");
                assert!(!marked, "{file}: {line}");
            }
        }
    }
    let page = fs::read_to_string(bench.at("leaderboard/site/index.html")).unwrap();
    assert!(
        page.contains("out of memory"),
        "the reason stands on the first page"
    );
}

#[test]
fn a_run_that_failed_leaves_its_views_where_they_were() {
    let folder = scratch();
    let train = format!("{LEAVES_VIEWS}\nexit 9");
    let manifest = method(folder.path(), "crashes", "", &train, "true");
    let sequence = small_run().out.join(SEQUENCE);
    let split = sequence.join("per-scene/split.json");
    let [scene, split] = [&sequence, &split].map(|path| path.to_str().unwrap());
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let external = [
        "bench",
        "external",
        manifest.to_str().unwrap(),
        "--scene",
        scene,
        "--split",
        split,
    ];
    let run = omnilife(external.into_iter().chain(["--out", &at("run")]));
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    let record: ExternalRun =
        store::read_record(&folder.path().join("run/external-run.json")).unwrap();
    assert!(record.failure.unwrap().contains("exit 9"));
    assert!(folder.path().join("run/work/000004.png").is_file());
    assert_eq!(
        store::names_in(&folder.path().join("run/predictions/novel")).unwrap(),
        [""; 0]
    );
    // Neither by its record nor by its folders.
    let head = [
        "--quiet", "bench", "score", "--scene", scene, "--split", split, "--out",
    ];
    let by_record = omnilife(
        head.into_iter()
            .chain([at("a").as_str(), "--run", &at("run")]),
    );
    assert_eq!(by_record.code, Some(2));
    let result: ResultRecord = store::read_record(&folder.path().join("a/result.json")).unwrap();
    assert!(!result.is_complete() && result.novel_views.is_empty());
    let by_folder = [at("b"), "--novel-views".to_owned(), at("run/work")];
    let by_folder = head.iter().map(|&word| word.to_owned()).chain(by_folder);
    let by_folder = omnilife(by_folder.chain(["--method", "crashes"].map(str::to_owned)));
    let message = by_folder.failed_quietly(2);
    assert!(
        message.contains("external-run.json") && message.contains("exit 9"),
        "{message}"
    );
    assert!(!folder.path().join("b").exists());
    let validated = [
        "--quiet", "bench", "validate", "--scene", scene, "--split", split, "--run",
    ];
    let validated = omnilife(validated.into_iter().chain([at("run").as_str()]));
    assert_eq!(validated.code, Some(2));
    let told = validated.stdout.matches("exit 9").count();
    assert_eq!(told, 1, "{}", validated.stdout);
}

/// Views of an edited model show another world than the video, whatever rendered them, and in whatever folder.
#[test]
fn views_of_an_edited_model_are_not_scored() {
    let copy = copy_of_small_run();
    let run = copy.path().join(METHOD).join("run");
    let record: omnilife_schemas::records::RunRecord =
        store::read_record(&run.join("run.json")).unwrap();
    let edited = record.edited(["remove 3".to_owned()], "predictions/novel");
    assert_eq!(
        (&edited.trace, &edited.trace_views, &edited.surfaces),
        (&None, &None, &None)
    );
    store::write_record(&run.join("run.json"), &edited).unwrap();
    let sequence = copy.path().join(SEQUENCE);
    let split = sequence.join("per-scene/split.json");
    let [scene, split, run] = [&sequence, &split, &run].map(|path| path.to_str().unwrap());
    let out = copy.path().join("scores");
    let head = [
        "--quiet", "bench", "score", "--scene", scene, "--split", split, "--out",
    ];
    let views = format!("{run}/predictions/novel");
    for further in [
        vec!["--run", run],
        vec!["--novel-views", &views, "--method", "mine"],
    ] {
        let words = head
            .into_iter()
            .chain([out.to_str().unwrap()])
            .chain(further);
        let message = omnilife(words).failed_quietly(2).to_owned();
        assert!(message.contains("was edited (remove 3)"), "{message}");
        assert!(!out.join("result.json").exists());
    }
}
