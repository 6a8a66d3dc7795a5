//! External methods, run by their own commands: stand-ins are shell scripts.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::{
    ExternalRequest, Predictions, ScoreRequest,
    external::{EXTERNAL_RUN_FILE, manifest::Manifest},
    run_external, score, unusable_views, validate,
};
use omnilife_schemas::{
    Classified, ErrorKind,
    progress::Silent,
    records::{ExternalRun, PhaseName, ResultRecord, Scene},
    store,
    testing::Notes,
};
use scenes::scene;
use scoring::Bench;

use crate::{scenes, scoring};

#[test]
fn the_example_of_the_guide_is_a_manifest() {
    let guide = include_str!("../../../docs/guides/external.md");
    let example = guide.split("```toml\n").nth(1).unwrap();
    let example = example.split("```").next().unwrap();
    let manifest = Manifest::from_bytes(Path::new("method.toml"), example.as_bytes()).unwrap();
    assert_eq!(manifest.id, "mine");
    assert_eq!(manifest.predictions.cell.unwrap().column, 1);
}

/// A scene, and a method whose commands run in `sh`.
struct ScriptedMethod {
    bench: Bench,
    request: ExternalRequest,
}

impl ScriptedMethod {
    fn new(manifest: &str) -> Self {
        let bench = Bench::new();
        let file = bench.at("method/method.toml");
        fs::create_dir(bench.at("method")).unwrap();
        fs::write(&file, manifest).unwrap();
        let request = ExternalRequest {
            manifest: file,
            scene: bench.request.scene.clone(),
            split: bench.request.split.clone(),
            seed: 7,
            out: bench.at("run"),
        };
        Self { bench, request }
    }

    fn run(&self) -> ExternalRun {
        run_external(&self.request, &Silent).unwrap()
    }

    fn refusal(&self) -> String {
        let error = run_external(&self.request, &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User, "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
        error.to_string()
    }

    fn score_request(&self) -> ScoreRequest {
        ScoreRequest {
            predictions: Predictions::Run(self.request.out.join("external-run.json")),
            method: "copier".to_owned(),
            out: self.bench.at("scores"),
            ..self.bench.request.clone()
        }
    }
}

/// Copies the predictions that the test scene comes with, under other names.
fn copier(bench_folder: &str) -> String {
    format!(
        r#"
id = "copier"
licence = "MIT"
[train]
command = ["sh", "-c", "echo trained with $0; test -f $1 && test -f $2", "{{seed}}", "{{scene}}", "{{split}}"]
[render]
command = ["sh", "-c", "mkdir -p v && for f in $0/*.png; do cp $f v/view-$(basename $f); done", "{bench_folder}"]
[predictions]
novel = "{{work}}/v/view-{{frame:06}}.png"
"#
    )
}

fn copying_stand() -> ScriptedMethod {
    let stand = ScriptedMethod::new("");
    let folder = stand.bench.at("novel").display().to_string();
    fs::write(&stand.request.manifest, copier(&folder)).unwrap();
    stand
}

#[test]
fn a_method_is_run_measured_and_scored() {
    let stand = copying_stand();
    let run = stand.run();
    assert_eq!(run.failure, None);
    assert_eq!(run.environment, "plain");
    let names: Vec<_> = run.phases.iter().map(|phase| phase.name).collect();
    assert_eq!(names, [PhaseName::Train, PhaseName::Render]);
    assert!(
        run.phases.iter().all(|phase| phase.ending == "exit 0"
            && phase.cpu_seconds.is_some_and(|seconds| seconds >= 0.0))
    );
    let log = fs::read_to_string(stand.request.out.join(&run.phases[0].log)).unwrap();
    assert_eq!(log, "trained with 7\n");

    let result = score(&stand.score_request(), &Silent).unwrap();
    let theirs = stand.bench.score().unwrap();
    assert_eq!(result.novel_views, theirs.novel_views);
    assert!(result.input_views.is_empty() && result.failures.is_empty());
    assert_eq!(result.training_seconds, Some(run.phases[0].wall_seconds));
}

/// A frame of the scene that is another one after the method ran: the method did not see what it is scored against.
#[test]
fn frames_that_changed_after_a_method_ran_are_told_with_its_scores() {
    let stand = copying_stand();
    let run = stand.run();
    let scene: Scene = store::read_record(&stand.request.scene).unwrap();
    let split = &stand.bench.split;
    let frames = || split.input_views.iter().chain(&split.novel_views);
    assert!(frames().all(|&frame| run.inputs.contains_key(&scene.frames[frame as usize].image)));
    let other_frames = |result: ResultRecord| {
        let mut warnings = result.warnings.into_iter();
        warnings.find(|line| line.contains("changed after the training"))
    };
    let same = score(&stand.score_request(), &Silent).unwrap();
    assert_eq!(other_frames(same), None);
    let frame = &scene.frames[split.novel_views[0] as usize].image;
    let file = stand.request.scene.with_file_name(frame);
    scoring::image(0, 9).write_png(&file).unwrap();
    let changed = score(&stand.score_request(), &Silent).unwrap();
    let line = other_frames(changed).unwrap();
    assert!(line.contains(": 1 (") && line.contains(frame), "{line}");
    assert_ne!(stand.run().inputs[frame], run.inputs[frame]);
}

/// An image that another program wrote over a view of the run.
#[test]
fn views_that_changed_after_their_run_are_told_with_its_scores() {
    let stand = copying_stand();
    let run = stand.run();
    let changed_views = |result: ResultRecord| {
        let mut warnings = result.warnings.into_iter();
        warnings.find(|line| line.contains("changed after the run"))
    };
    let whole = score(&stand.score_request(), &Silent).unwrap();
    assert_eq!(changed_views(whole), None);
    let name = format!("{:06}.png", stand.bench.split.novel_views[0]);
    let view = stand.request.out.join(&run.novel_views).join(&name);
    scoring::image(0, 9).write_png(&view).unwrap();
    let changed = score(&stand.score_request(), &Silent).unwrap();
    let line = changed_views(changed).unwrap();
    assert!(line.contains(": 1 (") && line.contains(&name), "{line}");
}

/// Views that are missing, of another size, grey, or of a format that is not read.
#[test]
fn views_that_cannot_be_scored_are_found_after_a_run() {
    let stand = copying_stand();
    let unusable = || {
        stand.run();
        let ExternalRequest {
            scene, split, out, ..
        } = &stand.request;
        unusable_views(scene, split, &out.join(EXTERNAL_RUN_FILE), &Silent).unwrap()
    };
    assert_eq!(unusable(), []);
    let novel = stand.bench.at("novel").display().to_string();
    let whole = copier(&novel);
    let first = format!("{:06}", stand.bench.split.novel_views[0]);
    let jpeg = stand.bench.at("grey.jpg");
    image::GrayImage::new(64, 32).save(&jpeg).unwrap();
    let jpeg = jpeg.display();
    for (change, expected) in [
        (format!("rm v/view-{first}.png"), "is missing"),
        (
            format!("echo text > v/view-{first}.png"),
            "is not a usable PNG",
        ),
        (
            format!("for f in v/*.png; do cp {jpeg} v/$(basename $f .png).jpg; done"),
            "is missing",
        ),
    ] {
        let ending = if change.contains(".jpg") {
            "jpg"
        } else {
            "png"
        };
        let changed = whole
            .replace("done\"", &format!("done; {change}\""))
            .replace("{frame:06}.png", &format!("{{frame:06}}.{ending}"));
        fs::write(&stand.request.manifest, changed).unwrap();
        let found = unusable();
        assert!(!found.is_empty(), "{change}");
        assert_eq!(found[0].view.as_deref(), Some("novel"));
        assert!(found[0].reason.contains(expected), "{found:?}");
    }
    // Grey values are refused whatever the format.
    let warnings = stand.run().warnings;
    assert!(
        warnings.iter().all(|one| one.contains("grey")),
        "{warnings:?}"
    );
    assert_eq!(warnings.len(), stand.bench.split.novel_views.len());
}

#[test]
fn an_unchanged_run_is_skipped_and_a_changed_seed_is_not() {
    let mut stand = copying_stand();
    let first = stand.run();
    let notes = Notes::default();
    assert_eq!(run_external(&stand.request, &notes).unwrap(), first);
    assert_eq!(notes.take().len(), 1);
    stand.request.seed = 8;
    let again = run_external(&stand.request, &notes).unwrap();
    assert_eq!((again.seed, notes.take().len()), (8, 0));
}

/// A failed method is a row of the tables, with the reason, and is run again.
#[test]
fn a_failed_method_is_scored_as_failures() {
    let stand = ScriptedMethod::new(
        r#"
id = "copier"
[train]
command = ["sh", "-c", "echo out of memory; exit 3"]
[render]
command = ["sh", "-c", "touch rendered"]
[predictions]
novel = "{work}/{frame}.png"
"#,
    );
    let run = stand.run();
    let failure = "train ended with exit 3: out of memory";
    assert_eq!(run.failure.as_deref(), Some(failure));
    assert_eq!(run.phases.len(), 1);
    assert!(!stand.request.out.join("work/rendered").exists());

    let result = score(&stand.score_request(), &Silent).unwrap();
    assert_eq!(result.failures.len(), stand.bench.split.novel_views.len());
    assert!(result.novel_views.is_empty());
    assert_eq!(result.run_failure.as_deref(), Some(failure));
    assert_eq!(result.training_seconds, None);

    let request = stand.score_request();
    let report = validate(
        &request.scene,
        &request.split,
        &request.predictions,
        &Silent,
    )
    .unwrap();
    assert_eq!(report.views, stand.bench.split.novel_views.len());
    assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
    assert_eq!(report.findings[0].view.as_deref(), Some("run"));
    assert!(report.findings[0].reason.contains(failure));

    let mended = fs::read_to_string(&stand.request.manifest)
        .unwrap()
        .replace("exit 3", "exit 0");
    fs::write(&stand.request.manifest, mended).unwrap();
    assert_eq!(stand.run().failure, None);
}

/// Child processes of a program end with it, by the time limit and by itself: the next one has the machine for itself.
#[test]
fn children_of_a_program_end_with_it() {
    for (rest, limit) in [("wait", "time_limit_seconds = 0.2"), ("exit 0", "")] {
        let stand = ScriptedMethod::new(&format!(
            r#"
id = "parent"
{limit}
[render]
command = ["sh", "-c", "(sleep 1.2; touch {{work}}/late) & {rest}"]
[predictions]
novel = "{{work}}/{{frame}}.png"
"#
        ));
        stand.run();
        std::thread::sleep(std::time::Duration::from_millis(1600));
        let late = stand.bench.at("run/work/late");
        assert!(late.parent().unwrap().is_dir() && !late.exists(), "{rest}");
    }
}

/// A child with a session of its own does not share the machine with the next command either.
#[test]
#[cfg(target_os = "linux")]
fn what_a_command_leaves_running_is_told_and_gone_before_the_next() {
    let stand = ScriptedMethod::new(
        r#"
id = "parent"
[train]
command = ["sh", "-c", "setsid sh -c 'echo $$ > own; exec sleep 300' & while ! test -s own; do sleep 0.01; done"]
[render]
command = ["sh", "-c", "! kill -0 $(cat own) 2> /dev/null"]
[predictions]
novel = "{work}/{frame}.png"
"#,
    );
    let run = stand.run();
    assert_eq!(run.failure, None);
    let own = fs::read_to_string(stand.request.out.join("work/own")).unwrap();
    let left = format!("sleep (process {})", own.trim());
    assert_eq!(run.phases[0].ending, "exit 0");
    assert_eq!(run.phases[0].left_running, std::slice::from_ref(&left));
    assert!(run.phases[1].left_running.is_empty());
    let told = run.warnings.iter().filter(|line| line.contains(&left));
    assert_eq!(told.count(), 1, "{:?}", run.warnings);
}

#[test]
fn endless_and_missing_programs_end_with_a_reason() {
    let stand = ScriptedMethod::new(
        r#"
id = "sleeper"
time_limit_seconds = 0.2
[render]
command = ["sleep", "600"]
[predictions]
novel = "{work}/{frame}.png"
"#,
    );
    let failure = stand.run().failure.unwrap();
    assert_eq!(failure, "render ended with the time limit of 0.2 s");

    let stand = ScriptedMethod::new(
        r#"
id = "absent"
[environment]
kind = "conda"
name = "nowhere"
[render]
command = ["true"]
[predictions]
novel = "{work}/{frame}.png"
"#,
    );
    // Without conda, or without the environment, the run has failed.
    let run = stand.run();
    assert!(run.failure.is_some());
    assert_eq!(run.phases[0].command[..2], ["conda", "run"]);
}

#[test]
fn a_virtual_environment_comes_first_on_the_path() {
    let stand = ScriptedMethod::new("");
    let venv = stand.bench.at("venv");
    fs::create_dir_all(venv.join("bin")).unwrap();
    let program = venv.join("bin/renderer");
    fs::write(&program, "#!/bin/sh\necho in $VIRTUAL_ENV\n").unwrap();
    let mut permissions = fs::metadata(&program).unwrap().permissions();
    std::os::unix::fs::PermissionsExt::set_mode(&mut permissions, 0o755);
    fs::set_permissions(&program, permissions).unwrap();
    fs::write(
        &stand.request.manifest,
        format!(
            "id = \"v\"\n[environment]\nkind = \"venv\"\npath = {:?}\n[render]\n\
             command = [\"sh\", \"-c\", \"renderer\"]\n[predictions]\nnovel = \"{{work}}/{{frame}}.png\"\n",
            venv.display().to_string()
        ),
    )
    .unwrap();
    let run = stand.run();
    assert_eq!(run.failure, None);
    let log = fs::read_to_string(stand.request.out.join("logs/render.log")).unwrap();
    assert_eq!(log, format!("in {}\n", venv.display()));
}

#[test]
fn mistakes_in_a_manifest_are_named() {
    let good = copier("/nowhere");
    for (from, to, expected) in [
        (
            "id = \"copier\"",
            "id = \"My Method\"",
            "id \"My Method\" is not",
        ),
        ("licence", "license", "line 3: unknown field `license`"),
        ("{seed}", "{sed}", "[train] \"{sed}\": {sed} is not known"),
        ("{frame:06}", "view", "the same file for every view"),
        ("[render]", "[draw]", "unknown field `draw`"),
        (
            "id =",
            "time_limit_seconds = -1\nid =",
            "must be positive, got -1 s",
        ),
        ("[train]", "[train", "line 4: "),
    ] {
        let stand = ScriptedMethod::new(&good.replacen(from, to, 1));
        let message = stand.refusal();
        let file: PathBuf = stand.request.manifest.clone();
        assert!(message.starts_with(file.to_str().unwrap()), "{message}");
        assert!(message.contains(expected), "{expected}: {message}");
    }
}

#[test]
fn a_split_of_another_scene_is_refused() {
    let stand = copying_stand();
    let mut other = scene(10, &[]);
    other.id = "other/seq-000".to_owned();
    scoring::write_scene(&stand.bench.at("scene"), &other);
    assert!(stand.refusal().contains("is of scene"));
    assert!(stand.bench.refusal().contains("is of scene"));
}

/// The natural mistake is the method's own checkout as the folder of the run.
#[test]
fn a_folder_with_anothers_logs_is_not_cleared() {
    let mut stand = copying_stand();
    stand.request.out = stand.bench.at("method");
    for name in ["work", "logs", "predictions"] {
        let folder = stand.request.out.join(name);
        fs::create_dir(&folder).unwrap();
        let precious = folder.join("precious");
        fs::write(&precious, "mine").unwrap();
        let message = stand.refusal();
        assert!(
            message.contains(name) && message.contains("no run of ours"),
            "{message}"
        );
        assert_eq!(fs::read_to_string(&precious).unwrap(), "mine");
        fs::remove_dir_all(&folder).unwrap();
        // An empty folder holds nothing that could be lost.
        fs::create_dir(&folder).unwrap();
    }
    let record = stand.request.out.join("external-run.json");
    fs::write(&record, "mine").unwrap();
    assert!(stand.refusal().contains("external-run.json: is in the way"));
    fs::remove_file(&record).unwrap();
    assert_eq!(stand.run().failure, None);
    // From now on the folder is the run's.
    stand.request.seed += 1;
    assert_eq!(stand.run().failure, None);
}

/// A sweep records the failure of a unit and tries it again.
#[test]
fn a_run_may_follow_a_recorded_failure_and_the_other_way_round() {
    let stand = copying_stand();
    let failure = omnilife_bench::FailureRequest {
        run: None,
        method: "copier".to_owned(),
        scene: stand.request.scene.clone(),
        split: stand.request.split.clone(),
        seed: 7,
        reason: "killed".to_owned(),
        out: stand.request.out.clone(),
    };
    for _ in 0..2 {
        omnilife_bench::record_failure(&failure, &Silent).unwrap();
        assert_eq!(stand.run().failure, None);
    }
}
