//! The tables of the scores of every view, and of the objects in it.

use std::path::Path;

use omnilife_schemas::{
    frame_scores::{FrameRow, FrameScores},
    object_scores::{ObjectRow, ObjectScores},
};

use crate::{
    error::BenchError,
    job::{ScoreKey, ScoringJob, ViewOutcome},
};

/// Writes one row per view. A view that could not be scored has empty scores; so have undefined or unavailable metrics.
pub(crate) fn write(
    path: &Path,
    job: &ScoringJob,
    outcomes: &[ViewOutcome],
) -> Result<(), BenchError> {
    let metrics = job.metrics.iter();
    let table = FrameScores {
        metrics: metrics.map(|metric| metric.metric.id.to_owned()).collect(),
        rows: outcomes.iter().map(|outcome| row(job, outcome)).collect(),
    };
    Ok(table.write(path)?)
}

pub(crate) fn write_objects(
    path: &Path,
    job: &ScoringJob,
    outcomes: &[ViewOutcome],
) -> Result<(), BenchError> {
    let rows = outcomes.iter().flat_map(|outcome| {
        let objects = outcome.objects.iter();
        objects.map(|(object, scores)| ObjectRow {
            view: outcome.view.kind.to_string(),
            frame: outcome.view.frame,
            object: object.clone(),
            scores: scores.clone(),
        })
    });
    let table = ObjectScores {
        metrics: job
            .of_objects()
            .map(|metric| metric.id.to_owned())
            .collect(),
        rows: rows.collect(),
    };
    Ok(table.write(path)?)
}

fn row(job: &ScoringJob, outcome: &ViewOutcome) -> FrameRow {
    let mut computed = 0;
    let scores = job.metrics.iter().map(|metric| {
        if metric.unavailable.is_some() {
            return None;
        }
        computed += 1;
        outcome.scores.as_ref().ok()?[computed - 1].ok()
    });
    let frame = outcome.view.frame;
    FrameRow {
        view: outcome.view.kind.to_string(),
        frame,
        time_seconds: job.scene.frames[frame as usize].time_seconds,
        distance_to_given: distance_to_given(job, frame),
        scores: scores.collect(),
    }
}

/// Returns the distance in world units from a frame's camera to the nearest camera of an input view; `None` if one of
/// them has no pose.
fn distance_to_given(job: &ScoringJob, frame: u32) -> Option<f64> {
    let position = |frame: u32| Some(job.scene.frames.get(frame as usize)?.pose?.centre());
    let own = position(frame)?;
    let given = job.split.input_views.iter().copied().filter_map(position);
    given
        .map(|other| own.distance(other))
        .min_by(f64::total_cmp)
}

/// Reads every non-empty score.
pub(crate) fn read(path: &Path) -> Result<Vec<(ScoreKey, f64)>, BenchError> {
    let table = FrameScores::read(path)?;
    let mut scores = Vec::new();
    for row in &table.rows {
        for (metric, score) in table.metrics.iter().zip(&row.scores) {
            let key = || ScoreKey {
                view: row.view.clone(),
                metric: metric.clone(),
                frame: row.frame,
            };
            scores.extend(score.map(|score| (key(), score)));
        }
    }
    Ok(scores)
}
