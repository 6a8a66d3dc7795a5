//! Scoring: folders of predicted views against a scene's images.
//!
//! Every fault of a method's files (a missing frame, another size, a truncated PNG) becomes a row in the result's
//! failures. Every fault of the scene, the split or the disk is an error. Nothing is resized, skipped or replaced to
//! obtain a score.

mod curve;
mod scored_files;

use std::{
    collections::BTreeMap,
    path::Path,
    time::{Instant, SystemTime},
};

use omnilife_schemas::{
    frame_scores::FRAME_SCORES_FILE,
    layout::{CURVE_FILE, RESULT_FILE, SCORING_FILE},
    object_scores::OBJECT_SCORES_FILE,
    progress::Progress,
    provenance,
    records::{ResultRecord, ScoringRecord},
    store,
};
use rayon::prelude::*;

use crate::{
    diagnosis,
    error::BenchError,
    frames_table,
    job::{ScoreRequest, ScoringJob, View, ViewKind, ViewOutcome},
    loaded_view::LoadedView,
    lpips::Backbone,
    memory,
    metrics::Need,
    side_by_side,
    split::without_content,
    statement, summary, truth,
};

/// Scores predictions and writes into `request.out`:
/// * `result.json`: means over the views and every failure;
/// * `scoring.json`: machine, time and memory of scoring;
/// * `frames.csv`: one row per view with columns `view`, `frame`, `time_seconds` and one per
///   metric, which are empty for a view that could not be scored or for which the metric is
///   undefined;
/// * `objects.csv`: one row per view and object in it, for protocols with metrics of single objects;
/// * `curve.csv`: PSNR, SSIM and LPIPS of the novel views along the training, for runs of ours that kept them;
/// * `comparisons/novel-<frame>.png`: prediction left, ground truth right, of every novel view
///   whose prediction could be read.
///
/// Frames are scored in parallel; the files are the same for every number of threads. Metrics that cannot be computed
/// (weights, masks or depth are missing) are listed in the result with the reason, and never given as a number. If
/// scene, split, predictions and ground truth are unchanged, nothing is computed, a note says so and the stored result
/// is returned.
///
/// # Errors
/// When scene, split or run do not belong together, a ground truth image is unusable, a folder of predictions is
/// missing, or a file cannot be written. Also when the output folder holds the result of another method, scene or
/// protocol, or foreign files.
pub fn score(request: &ScoreRequest, progress: &dyn Progress) -> Result<ResultRecord, BenchError> {
    statement::check_method(&request.method)?;
    let job = ScoringJob::prepare(request)?;
    let result_file = request.out.join(RESULT_FILE);
    refuse_another_result(&job, &result_file)?;
    let plan = job.stage(&request.out)?;
    let label = format!("scoring {} on {}", job.method, job.scene.id);
    if plan.is_done() {
        progress.note(&format!("{label}: skipped, nothing has changed"));
        return Ok(store::read_record(&result_file)?);
    }
    let views = job.views();
    plan.run(planned_files(&views), progress, |out| {
        let started = Instant::now();
        // A result whose inputs have changed must not be found by a leaderboard if scoring fails now.
        store::remove(&result_file)?;
        plan.own_files()
            .remove(|file| [CURVE_FILE, OBJECT_SCORES_FILE].contains(&file))?;
        side_by_side::prepare_folder(&request.out, &plan.own_files())?;

        progress.begin(&label, Some(views.len() as u64));
        progress.status(&slowest(&job));
        let outcomes = score_views(&job, &views, request, progress)?;
        progress.end();

        frames_table::write(&request.out.join(FRAME_SCORES_FILE), &job, &outcomes)?;
        let mut result = summary::result_record(&job, &outcomes);
        if let Some(objects) = &result.objects {
            frames_table::write_objects(&request.out.join(&objects.table), &job, &outcomes)?;
            out.add(objects.table.clone());
        }
        result.predictions = Some(scored_files::of_job(&job, &request.out)?);
        job.statement.apply(&mut result);
        let single_colour = outcomes.iter().filter(|one| one.is_truth_single_colour);
        let empty = without_content(single_colour.map(|one| one.view.frame));
        for line in truth::mask_notes(&job, &views)?.into_iter().chain(empty) {
            progress.note(&format!("{label}: {line}"));
            // A run of ours has reported its masks.
            if !result.warnings.contains(&line) {
                result.warnings.push(line);
            }
        }
        let likely_mistakes = diagnosis::of_job(&job, request.memory_bytes)?.warnings();
        result.warnings = [likely_mistakes, result.warnings].concat();
        let unscored = curve::write_curve(&job, request.memory_bytes, &request.out, progress)?;
        result.warnings.extend(unscored.iter().flatten().cloned());
        out.write_record(RESULT_FILE, &result)?;
        write_scoring_record(&request.out, &result_file, started)?;
        out.add_all([SCORING_FILE, FRAME_SCORES_FILE]);
        out.add_all(unscored.map(|_| CURVE_FILE));
        let comparisons = outcomes.into_iter().map(|outcome| outcome.comparison);
        out.add_all(comparisons.flatten());
        Ok(result)
    })
}

/// Returns the name of the slowest part.
fn slowest(job: &ScoringJob) -> String {
    let networks: Vec<&str> = Backbone::ALL
        .into_iter()
        .rev()
        .filter(|&network| job.needs(Need::Network(network)))
        .map(Backbone::weights)
        .collect();
    if networks.is_empty() {
        format!("{} metrics", job.computed().count())
    } else {
        format!("mostly {}", networks.join(", "))
    }
}

/// Lists the files that scoring may write, relative to the output folder.
fn planned_files(views: &[View]) -> impl Iterator<Item = String> {
    let images = views
        .iter()
        .filter(|view| view.kind == ViewKind::Novel)
        .map(|&view| side_by_side::file(view));
    [
        RESULT_FILE,
        SCORING_FILE,
        FRAME_SCORES_FILE,
        OBJECT_SCORES_FILE,
        CURVE_FILE,
    ]
    .map(str::to_owned)
    .into_iter()
    .chain(images)
}

/// Writes facts that vary between computations of the same scores.
fn write_scoring_record(
    out: &Path,
    result_file: &Path,
    started: Instant,
) -> Result<(), BenchError> {
    let record = ScoringRecord {
        result_sha256: store::sha256_file(result_file)?,
        versions: provenance::versions(),
        hardware: provenance::Hardware::here(),
        scored_at: Some(provenance::utc(SystemTime::now())),
        threads: rayon::current_num_threads() as u32,
        wall_seconds: started.elapsed().as_secs_f64(),
        peak_memory_bytes: provenance::peak_memory_bytes(),
    };
    Ok(store::write_record(&out.join(SCORING_FILE), &record)?)
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
    let mut previous: Option<LoadedView> = None;
    for views in views.chunks(together) {
        let loaded: Vec<Result<LoadedView, BenchError>> = views
            .par_iter()
            .map(|&view| go_on(progress).and_then(|()| LoadedView::read(job, view)))
            .collect();
        // The first error in the order of views, independently of threads.
        let mut loaded = loaded.into_iter().collect::<Result<Vec<_>, _>>()?;
        let scored: Vec<Result<ViewOutcome, BenchError>> = loaded
            .par_iter()
            .enumerate()
            .map(|(index, view)| {
                let before = match index {
                    0 => previous.as_ref(),
                    index => loaded.get(index - 1),
                };
                go_on(progress)?;
                let outcome = score_view(job, view, before, &request.out);
                progress.advance(1);
                outcome
            })
            .collect();
        outcomes.extend(scored.into_iter().collect::<Result<Vec<_>, _>>()?);
        previous = loaded.pop();
    }
    Ok(outcomes)
}

/// Returns an error once the work is cancelled.
fn go_on(progress: &dyn Progress) -> Result<(), BenchError> {
    if progress.is_interrupted() {
        return Err(BenchError::Interrupted);
    }
    Ok(())
}

fn score_view(
    job: &ScoringJob,
    loaded: &LoadedView,
    previous: Option<&LoadedView>,
    out: &Path,
) -> Result<ViewOutcome, BenchError> {
    let view = loaded.view;
    let pair = match &loaded.pair {
        Ok(pair) => pair,
        Err(reason) => {
            return Ok(ViewOutcome {
                view,
                scores: Err(reason.clone()),
                objects: BTreeMap::new(),
                is_identical: false,
                ignores_pixels: loaded.ignores_pixels,
                is_truth_single_colour: loaded.is_truth_single_colour,
                comparison: None,
            });
        }
    };
    let comparison = match view.kind {
        ViewKind::Input => None,
        ViewKind::Novel => Some(side_by_side::write(out, view, pair)?),
    };
    let sample = loaded.sample(pair, previous);
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
        objects: loaded.of_objects(job, pair),
        is_identical: pair.prediction() == pair.truth(),
        ignores_pixels: loaded.ignores_pixels,
        is_truth_single_colour: loaded.is_truth_single_colour,
        comparison,
    })
}

/// Refuses a folder of another method, scene or protocol: its scores are not overwritten.
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
