//! Resumed runs: an interrupted run resumes as if it had run through, and only from its own complete checkpoint.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use omnilife_engine::model::Model;
use omnilife_reconstruct::{
    ReconstructError,
    methods::{self, MethodOutcome},
    options::Options,
    request::MethodRequest,
    scene::TrainingScene,
    train::{Session, TrainingFiles},
};
use omnilife_schemas::progress::{Progress, Silent};

use crate::support::{balls, trained::files};

const ITERATIONS: u64 = 120;
const EVERY: u64 = 50;

fn request() -> MethodRequest {
    MethodRequest {
        options: Options::of_sh_degree(1),
        // Rows at equal ratios of time differ from run to run.
        trace_every: Some(20),
        ..MethodRequest::new(ITERATIONS, 3)
    }
}

fn train<'a>(
    scene: &'a TrainingScene,
    request: &MethodRequest,
    files: TrainingFiles,
    progress: &dyn Progress,
) -> Result<MethodOutcome<'a>, ReconstructError> {
    let session = Session {
        files: Some(files),
        ..Session::without_files(progress)
    };
    methods::find("odgs")
        .unwrap()
        .train(scene, request, &session)
}

/// Copies the checkpoint at the end of an iteration.
struct CopyAt {
    iteration: u64,
    from: PathBuf,
    to: PathBuf,
    done: AtomicU64,
}

impl Progress for CopyAt {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, steps: u64) {
        if self.done.fetch_add(steps, Ordering::Relaxed) + steps == self.iteration {
            fs::copy(&self.from, &self.to).unwrap();
        }
    }
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, _: &str) {}
}

/// Returns a whole run, and a folder with the checkpoint of its iteration `EVERY`.
fn whole_run(scene: &TrainingScene, folder: &Path) -> (Model, Vec<[Option<f64>; 2]>, PathBuf) {
    let interrupted = folder.join("interrupted");
    fs::create_dir(&interrupted).unwrap();
    let copy = CopyAt {
        iteration: EVERY + 5,
        from: files(folder, EVERY).checkpoint,
        to: files(&interrupted, EVERY).checkpoint,
        done: AtomicU64::new(0),
    };
    let mut whole = train(scene, &request(), files(folder, EVERY), &copy).unwrap();
    let trace = losses(&whole);
    let model = whole.learner.gaussians().unwrap().unwrap().clone();
    (model, trace, interrupted)
}

fn losses(outcome: &MethodOutcome<'_>) -> Vec<[Option<f64>; 2]> {
    let trace = outcome.training.state.trace.iter();
    trace
        .map(|point| [point.train_loss, point.train_psnr_db])
        .collect()
}

#[test]
fn a_continued_run_gives_the_same_bits() {
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let (whole, trace, interrupted) = whole_run(&scene, folder.path());
    let mut continued = train(&scene, &request(), files(&interrupted, EVERY), &Silent).unwrap();
    assert_eq!(continued.training.state.resumed, 1);
    let warning = &continued.training.warnings[0];
    assert!(warning.contains("iteration 50 of 120"), "{warning}");
    assert_eq!(losses(&continued), trace);
    let model = continued.learner.gaussians().unwrap().unwrap();
    assert_eq!(model.parts[0].statistics, whole.parts[0].statistics);
    for (one, other) in model.parts[0]
        .table
        .arrays
        .iter()
        .zip(&whole.parts[0].table.arrays)
    {
        assert!(
            one.values == other.values
                && one.first_moments == other.first_moments
                && one.second_moments == other.second_moments,
            "{}",
            one.name
        );
    }
    let rows = fs::read_to_string(files(&interrupted, EVERY).trace).unwrap();
    assert_eq!(rows.lines().count(), trace.len() + 1, "{rows}");
    assert!(rows.starts_with("wall_seconds,") && rows.contains(",refused_sh_rest\n"));
}

#[test]
fn a_checkpoint_of_another_run_is_not_continued_and_that_is_said() {
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let (_, _, interrupted) = whole_run(&scene, folder.path());
    let other_inputs = TrainingFiles {
        inputs_sha256: "another scene".to_owned(),
        ..files(&interrupted, EVERY)
    };
    let outcome = train(&scene, &request(), other_inputs, &Silent).unwrap();
    let warning = &outcome.training.warnings[0];
    assert!(
        warning.contains("another scene") && warning.contains("begins anew"),
        "{warning}"
    );
    assert_eq!(outcome.training.state.resumed, 0);
}

#[test]
fn a_damaged_checkpoint_is_refused_with_the_reason() {
    let scene = balls::scene();
    let folder = tempfile::tempdir().unwrap();
    let (_, _, interrupted) = whole_run(&scene, folder.path());
    let path = files(&interrupted, EVERY).checkpoint;
    let whole = fs::read(&path).unwrap();
    let refused = |bytes: Vec<u8>| {
        fs::write(&path, &bytes).unwrap();
        let outcome = train(&scene, &request(), files(&interrupted, EVERY), &Silent);
        let message = outcome.map(drop).unwrap_err().to_string();
        assert!(
            message.starts_with(&path.display().to_string()) && message.contains("begin anew"),
            "{message}"
        );
        assert_eq!(fs::read(&path).unwrap(), bytes, "it is left as it was");
        message
    };
    assert!(refused(whole[..whole.len() - 1].to_vec()).contains("truncated"));
    assert!(refused(whole[..300].to_vec()).contains("truncated"));
    assert!(refused(b"something else\n".to_vec()).contains("is not a checkpoint"));
    assert!(refused(Vec::new()).contains("is not a checkpoint"));
    let mut newer = whole.clone();
    newer["omnilife/checkpoint/".len()] = b'9';
    assert!(refused(newer).contains("version 9"));
    let mut flipped = whole.clone();
    let middle = flipped.len() - 1_000;
    flipped[middle] ^= 1;
    assert!(refused(flipped).contains("damaged"));
}
