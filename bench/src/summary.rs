//! The result record: means over views, and what failed.

use std::collections::BTreeMap;

use omnilife_schemas::records::{Failure, ResultRecord, Summary};

use crate::{
    frames_table::FRAMES_TABLE,
    protocols,
    score::ViewOutcome,
    scoring_job::{ScoringJob, ViewKind},
};

/// Summarizes the outcomes of all views of a job.
pub(crate) fn result_record(job: &ScoringJob, outcomes: &[ViewOutcome]) -> ResultRecord {
    let failures = outcomes
        .iter()
        .filter_map(|outcome| {
            outcome.scores.as_ref().err().map(|reason| Failure {
                view: outcome.view.kind.to_string(),
                frame: outcome.view.frame,
                reason: reason.clone(),
            })
        })
        .collect();
    ResultRecord {
        method: job.method.clone(),
        scene: job.scene.id.clone(),
        scene_sha256: job.identity.sha256.clone(),
        protocol: protocols::title(&job.split.protocol),
        protocol_hash: job.split.protocol_hash.clone(),
        scored_size: job.size,
        input_views: means(job, outcomes, ViewKind::Input),
        novel_views: means(job, outcomes, ViewKind::Novel),
        failures,
        frames_table: FRAMES_TABLE.to_owned(),
        training_seconds: job.run.as_ref().and_then(|run| run.training_seconds),
        gaussians: job.run.as_ref().and_then(|run| run.gaussians),
        iterations: job.run.as_ref().and_then(|run| run.iterations),
        seed: job.run.as_ref().map(|run| run.seed),
        backend: job.run.as_ref().and_then(|run| run.backend.clone()),
        rendering_seconds: job.run.as_ref().and_then(|run| run.rendering_seconds),
        peak_memory_bytes: job.run.as_ref().and_then(|run| run.peak_memory_bytes),
        warnings: job.warnings(),
    }
}

/// Mean of every metric over the scored views of one kind, in the order of views; no entries
/// without scored views.
fn means(job: &ScoringJob, outcomes: &[ViewOutcome], kind: ViewKind) -> BTreeMap<String, Summary> {
    let scored: Vec<&Vec<f64>> = outcomes
        .iter()
        .filter(|outcome| outcome.view.kind == kind)
        .filter_map(|outcome| outcome.scores.as_ref().ok())
        .collect();
    if scored.is_empty() {
        return BTreeMap::new();
    }
    let summaries = job.metrics.iter().enumerate().map(|(index, metric)| {
        let sum: f64 = scored.iter().map(|scores| scores[index]).sum();
        let summary = Summary {
            mean: sum / scored.len() as f64,
            views: scored.len() as u32,
            direction: metric.direction,
        };
        (metric.id.to_owned(), summary)
    });
    summaries.collect()
}
