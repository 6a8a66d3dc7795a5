//! Scoring: folders of predicted views against a scene's images.
//!
//! Everything a method could get wrong with its files (a missing frame, another size, a truncated
//! PNG) becomes a row in the result's failures; everything wrong with the scene, the split or the
//! disk is an error. Nothing is resized, skipped or replaced to make a score come out.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    lock::FolderLock,
    progress::Progress,
    provenance,
    records::{ResultRecord, ScoringRecord},
    store,
};
use rayon::prelude::*;

use crate::{
    comparison,
    curve::scored::{self, CURVE_FILE},
    diagnosis,
    error::BenchError,
    evidence::Evidence,
    frames_table::{self, FRAMES_TABLE},
    memory,
    metrics::Undefined,
    run_facts::RunFacts,
    scoring_job::{ScoringJob, View, ViewKind},
    summary,
};

/// File name of the scores in the output folder.
pub const RESULT_FILE: &str = "result.json";

/// File name of how the scores were computed, in the output folder.
pub const SCORING_FILE: &str = "scoring.json";

/// Where the predictions are: `<folder>/<frame, 6 digits>.png`, 8-bit RGB at the protocol's size,
/// or the same name with `.npy` for values in [0, 1] of shape (height, width, 3); frame numbers as
/// in the split.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Predictions {
    /// Folders from any method. A kind of view without a folder is not scored, and the result
    /// says so; at least one is needed.
    Folders {
        /// Predictions of the input views.
        input_views: Option<PathBuf>,
        /// Predictions of the novel views.
        novel_views: Option<PathBuf>,
    },
    /// The `run.json` or `external-run.json` of a run, which names the folders; its training time,
    /// primitives, iterations and warnings go into the result.
    Run(PathBuf),
}

/// What to score.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScoreRequest {
    /// The `scene.json` with the ground truth.
    pub scene: PathBuf,
    /// The `split.json` of that scene; it holds the protocol.
    pub split: PathBuf,
    /// The predictions.
    pub predictions: Predictions,
    /// Id of the method, as it will stand in the tables.
    pub method: String,
    /// Folder for `result.json`, `scoring.json`, `frames.parquet` and `comparisons/`; made where it
    /// is missing.
    pub out: PathBuf,
    /// About how much memory views may take together, bytes. It decides how many are scored at
    /// once, one at least, and changes no score.
    pub memory_bytes: u64,
}

/// What scoring takes at most where nothing else is asked for: 2 GB.
pub const DEFAULT_MEMORY_BYTES: u64 = 2_000_000_000;

impl ScoreRequest {
    /// A request for a run, with the method's id from its record.
    ///
    /// # Errors
    /// When `run` cannot be read.
    pub fn of_run(scene: &Path, split: &Path, run: &Path, out: &Path) -> Result<Self, BenchError> {
        let method = RunFacts::read(run)?.method;
        Ok(Self {
            scene: scene.to_owned(),
            split: split.to_owned(),
            predictions: Predictions::Run(run.to_owned()),
            method,
            out: out.to_owned(),
            memory_bytes: DEFAULT_MEMORY_BYTES,
        })
    }
}

/// Scores predictions and writes into `request.out`:
/// * `result.json`: means over the views and every failure;
/// * `scoring.json`: machine, time and memory of scoring;
/// * `frames.parquet`: one row per view with columns `view`, `frame`, `time_seconds` and one per
///   metric, which are null for a view that could not be scored or for which the metric is
///   undefined;
/// * `curve.csv`: PSNR and SSIM of the novel views along the training, for runs of ours that kept them;
/// * `comparisons/novel-<frame>.png`: prediction left, ground truth right, of every novel view
///   whose prediction could be read.
///
/// Frames are scored in parallel; the files are the same for every number of threads. Metrics that
/// cannot be computed (weights, masks or depth are missing) are listed in the result with the
/// reason, and never stand as a number. Where
/// scene, split, predictions and ground truth have not changed since the last time, nothing is
/// computed, a note says so and the stored result is returned.
///
/// # Errors
/// When scene, split or run do not belong together, a ground truth image is unusable, a folder of
/// predictions is not there, the output folder holds the result of another method, scene or
/// protocol, or files that scoring has not made, or a file cannot be written.
pub fn score(request: &ScoreRequest, progress: &dyn Progress) -> Result<ResultRecord, BenchError> {
    let job = ScoringJob::prepare(request)?;
    let result_file = request.out.join(RESULT_FILE);
    refuse_another_result(&job, &result_file)?;
    let plan = job.stage(&request.out)?;
    let label = format!("scoring {} on {}", job.method, job.scene.id);
    if plan.is_done() {
        progress.note(&format!("{label}: skipped, nothing has changed"));
        return Ok(store::read_record(&result_file)?);
    }
    let _lock = FolderLock::take(&request.out, progress)?;
    let started = Instant::now();
    let views = job.views();
    plan.claim(planned_files(&views))?;
    // A result whose inputs have changed must not be found by a leaderboard if scoring fails now.
    store::remove(&result_file)?;
    plan.own_files().remove(|file| file == CURVE_FILE)?;
    comparison::prepare_folder(&request.out, &plan.own_files())?;

    progress.begin(&label, Some(views.len() as u64));
    let outcomes = score_views(&job, &views, request, progress)?;
    progress.end();

    frames_table::write(&request.out.join(FRAMES_TABLE), &job, &outcomes)?;
    let mut result = summary::result_record(&job, &outcomes);
    result.warnings.extend(diagnosis::of_job(&job)?.remark());
    let unscored = scored::write_curve(&job, request.memory_bytes, &request.out)?;
    result.warnings.extend(unscored.iter().flatten().cloned());
    store::write_record(&result_file, &result)?;
    write_scoring_record(&request.out, &result_file, started)?;
    let mut outputs = [RESULT_FILE, SCORING_FILE, FRAMES_TABLE]
        .map(str::to_owned)
        .to_vec();
    outputs.extend(unscored.is_some().then(|| CURVE_FILE.to_owned()));
    outputs.extend(
        outcomes
            .iter()
            .filter_map(|outcome| outcome.comparison.clone()),
    );
    plan.finish(outputs, started.elapsed().as_secs_f64())?;
    Ok(result)
}

/// What scoring may write, relative to the output folder.
fn planned_files(views: &[View]) -> impl Iterator<Item = String> {
    let pictures = views
        .iter()
        .filter(|view| view.kind == ViewKind::Novel)
        .map(|&view| comparison::file(view));
    [RESULT_FILE, SCORING_FILE, FRAMES_TABLE, CURVE_FILE]
        .map(str::to_owned)
        .into_iter()
        .chain(pictures)
}

/// Writes what differs from one computation of the same scores to the next.
fn write_scoring_record(
    out: &Path,
    result_file: &Path,
    started: Instant,
) -> Result<(), BenchError> {
    let record = ScoringRecord {
        result_sha256: store::sha256_file(result_file)?,
        versions: provenance::versions(),
        hardware: provenance::Hardware::here(),
        threads: rayon::current_num_threads() as u32,
        wall_seconds: started.elapsed().as_secs_f64(),
        peak_memory_bytes: provenance::peak_memory_bytes(),
    };
    Ok(store::write_record(&out.join(SCORING_FILE), &record)?)
}

/// What became of one view.
pub(crate) struct ViewOutcome {
    /// The view.
    pub(crate) view: View,
    /// One value per available metric of the protocol, or why there are none.
    pub(crate) scores: Result<Vec<Result<f64, Undefined>>, String>,
    /// Whether the prediction is the ground truth, byte for byte.
    pub(crate) is_identical: bool,
    /// Comparison image relative to the output folder.
    comparison: Option<String>,
}

/// Scores views in their order, as many at once as the memory allows.
fn score_views(
    job: &ScoringJob,
    views: &[View],
    request: &ScoreRequest,
    progress: &dyn Progress,
) -> Result<Vec<ViewOutcome>, BenchError> {
    let together = memory::views_together(job, request.memory_bytes);
    let mut outcomes = Vec::with_capacity(views.len());
    let mut previous: Option<Evidence> = None;
    for views in views.chunks(together) {
        let evidence: Vec<Result<Evidence, BenchError>> = views
            .par_iter()
            .map(|&view| Evidence::read(job, view))
            .collect();
        // The first error in the order of views, whichever thread met one first.
        let mut evidence = evidence.into_iter().collect::<Result<Vec<_>, _>>()?;
        let scored: Vec<Result<ViewOutcome, BenchError>> = evidence
            .par_iter()
            .enumerate()
            .map(|(index, view)| {
                let before = match index {
                    0 => previous.as_ref(),
                    index => evidence.get(index - 1),
                };
                let outcome = score_view(job, view, before, &request.out);
                progress.advance(1);
                outcome
            })
            .collect();
        outcomes.extend(scored.into_iter().collect::<Result<Vec<_>, _>>()?);
        previous = evidence.pop();
    }
    Ok(outcomes)
}

fn score_view(
    job: &ScoringJob,
    evidence: &Evidence,
    previous: Option<&Evidence>,
    out: &Path,
) -> Result<ViewOutcome, BenchError> {
    let view = evidence.view;
    let pair = match &evidence.pair {
        Ok(pair) => pair,
        Err(reason) => {
            return Ok(ViewOutcome {
                view,
                scores: Err(reason.clone()),
                is_identical: false,
                comparison: None,
            });
        }
    };
    let comparison = match view.kind {
        ViewKind::Input => None,
        ViewKind::Novel => Some(comparison::write(out, view, pair)?),
    };
    let sample = evidence.sample(pair, previous);
    let scores = job
        .computed()
        .map(|metric| match (metric.function)(&sample) {
            Ok(value) if !value.is_finite() => Err(BenchError::internal(
                out,
                format!(
                    "{} of {} view {} is {value}",
                    metric.id, view.kind, view.frame
                ),
            )),
            value => Ok(value),
        })
        .collect::<Result<_, _>>()?;
    Ok(ViewOutcome {
        view,
        scores: Ok(scores),
        is_identical: pair.prediction() == pair.truth(),
        comparison,
    })
}

/// A folder belongs to one method, scene and protocol: the scores of another are not overwritten.
fn refuse_another_result(job: &ScoringJob, result_file: &Path) -> Result<(), BenchError> {
    if !result_file.exists() {
        return Ok(());
    }
    let old: ResultRecord = store::read_record(result_file)?;
    if old.method == job.method
        && old.scene == job.scene.id
        && old.protocol_hash == job.split.protocol_hash
    {
        return Ok(());
    }
    Err(BenchError::mismatch(
        result_file,
        format!(
            "holds the scores of method {} on scene {} under protocol {}; choose another folder",
            old.method, old.scene, old.protocol
        ),
    ))
}
