//! Scoring: folders of predicted views against a scene's images.
//!
//! Everything a method could get wrong with its files (a missing frame, another size, a truncated
//! PNG) becomes a row in the result's failures; everything wrong with the scene, the split or the
//! disk is an error. Nothing is resized, skipped or replaced to make a score come out.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{progress::Progress, records::ResultRecord, store};
use rayon::prelude::*;

use crate::{
    comparison,
    error::BenchError,
    frames_table::{self, FRAMES_TABLE},
    metrics::ViewPair,
    prediction,
    run_facts::RunFacts,
    scoring_job::{ScoringJob, View, ViewKind},
    summary, truth,
};

/// File name of the scores in the output folder.
pub const RESULT_FILE: &str = "result.json";

/// Where the predictions are: `<folder>/<frame, 6 digits>.png`, 8-bit RGB at the protocol's size,
/// frame numbers as in the split.
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
    /// Gaussians, iterations and warnings go into the result.
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
    /// Folder for `result.json`, `frames.parquet` and `comparisons/`; made where it is missing.
    pub out: PathBuf,
}

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
        })
    }
}

/// Scores predictions and writes into `request.out`:
/// * `result.json`: means over the views and every failure;
/// * `frames.parquet`: one row per view with columns `view`, `frame`, `time_seconds` and one per
///   metric, which are null for a view that could not be scored;
/// * `comparisons/novel-<frame>.png`: prediction left, ground truth right, of every novel view
///   whose prediction could be read.
///
/// Frames are scored in parallel; the files are the same for every number of threads. Where
/// scene, split, predictions and ground truth have not changed since the last time, nothing is
/// computed, a note says so and the stored result is returned.
///
/// # Errors
/// When scene, split or run do not belong together, a ground truth image is unusable, a folder of
/// predictions is not there, the output folder holds the result of another method, scene or
/// protocol, or a file cannot be written.
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
    let started = Instant::now();
    plan.begin()?;
    // A result whose inputs have changed must not be found by a leaderboard if scoring fails now.
    store::remove(&result_file)?;
    comparison::prepare_folder(&request.out)?;

    let views = job.views();
    progress.begin(&label, Some(views.len() as u64));
    let outcomes: Vec<Result<ViewOutcome, BenchError>> = views
        .into_par_iter()
        .map(|view| {
            let outcome = score_view(&job, view, &request.out);
            progress.advance(1);
            outcome
        })
        .collect();
    progress.end();
    // The first error in the order of views, whichever thread met one first.
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;

    frames_table::write(&request.out.join(FRAMES_TABLE), &job, &outcomes)?;
    let result = summary::result_record(&job, &outcomes);
    store::write_record(&result_file, &result)?;
    let mut outputs = vec![RESULT_FILE.to_owned(), FRAMES_TABLE.to_owned()];
    outputs.extend(
        outcomes
            .iter()
            .filter_map(|outcome| outcome.comparison.clone()),
    );
    plan.finish(outputs, started.elapsed().as_secs_f64())?;
    Ok(result)
}

/// What became of one view.
pub(crate) struct ViewOutcome {
    /// The view.
    pub(crate) view: View,
    /// One value per metric of the protocol, or why there are none.
    pub(crate) scores: Result<Vec<f64>, String>,
    /// Comparison image relative to the output folder.
    comparison: Option<String>,
}

fn score_view(job: &ScoringJob, view: View, out: &Path) -> Result<ViewOutcome, BenchError> {
    let truth_bytes = truth::read(job, view.frame)?;
    let [width, height] = job.size;
    let file = job.prediction_file(view);
    let predicted = match prediction::read(&file, width, height) {
        Ok(predicted) => predicted,
        Err(reason) => {
            return Ok(ViewOutcome {
                view,
                scores: Err(reason),
                comparison: None,
            });
        }
    };
    let comparison = match view.kind {
        ViewKind::Input => None,
        ViewKind::Novel => Some(comparison::write(
            out,
            view,
            width,
            height,
            &predicted,
            &truth_bytes,
        )?),
    };
    let pair = ViewPair::new(width as usize, height as usize, predicted, truth_bytes)
        .ok_or_else(|| BenchError::internal(&file, "image buffers differ in size"))?;
    let scores = job
        .metrics
        .iter()
        .map(|metric| {
            let value = (metric.function)(&pair);
            if value.is_finite() {
                Ok(value)
            } else {
                Err(BenchError::internal(
                    &file,
                    format!("{} is {value}", metric.id),
                ))
            }
        })
        .collect::<Result<_, _>>()?;
    Ok(ViewOutcome {
        view,
        scores: Ok(scores),
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
