//! The result record: means over views, failures and unavailable metrics.

mod objects;

use std::collections::BTreeMap;

use omnilife_schemas::{
    frame_scores::FRAME_SCORES_FILE,
    provenance,
    records::{Failure, ResultRecord, ScoredRegions, Summary, Unavailable},
};

use crate::{
    job::{JobMetric, ScoringJob, ViewKind, ViewOutcome},
    metrics::{Metric, Need, Undefined},
    protocols,
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
    let [input, novel] =
        [ViewKind::Input, ViewKind::Novel].map(|kind| summaries(job, outcomes, kind));
    ResultRecord {
        method: job.method.clone(),
        scene: job.scene.id.clone(),
        scene_sha256: job.identity.sha256.clone(),
        protocol: protocols::title(&job.split.protocol),
        protocol_hash: job.split.protocol_hash.clone(),
        rules: Some(job.split.protocol.clone()),
        scored_size: job.size,
        input_views: input.0,
        novel_views: novel.0,
        run_failure: job.run.as_ref().and_then(|run| run.failure.clone()),
        failures,
        unavailable: [input.1, novel.1].concat(),
        regions: (job.regions.as_ref())
            .filter(|_| job.needs(Need::DynamicMask))
            .map(|regions| ScoredRegions {
                source: "tracks".to_owned(),
                sha256: regions.sha256.clone(),
            }),
        frames_table: FRAME_SCORES_FILE.to_owned(),
        objects: objects::of_job(job, outcomes),
        predictions: None,
        statement: None,
        training: job.run.as_ref().and_then(|run| run.training),
        aids: job.run.as_ref().and_then(|run| run.aids.clone()),
        training_seconds: job.run.as_ref().and_then(|run| run.training_seconds),
        primitives: job.run.as_ref().and_then(|run| run.primitives),
        iterations: job.run.as_ref().and_then(|run| run.iterations),
        seed: job.run.as_ref().map(|run| run.seed),
        backend: job.run.as_ref().and_then(|run| run.backend.clone()),
        hardware: job.run.as_ref().and_then(|run| run.hardware.clone()),
        rendering_seconds: job.run.as_ref().and_then(|run| run.rendering_seconds),
        stages: (job.run.as_ref())
            .map(|run| run.stages.clone())
            .unwrap_or_default(),
        peak_memory_bytes: job.run.as_ref().and_then(|run| run.peak_memory_bytes),
        warnings: [
            job.warnings(),
            ignoring_views(outcomes),
            identical_views(outcomes),
            identical_regions(job, outcomes),
        ]
        .concat(),
        versions: versions(job),
        options: (job.run.as_ref())
            .map(|run| run.options.clone())
            .unwrap_or_default(),
        run_inputs: (job.run.as_ref())
            .map(|run| run.inputs_beside_images(&job.scene))
            .unwrap_or_default(),
        run_versions: (job.run.as_ref())
            .map(|run| run.versions.clone())
            .unwrap_or_default(),
    }
}

/// Returns summaries of every metric over the scored views of one kind, in the order of views, and the metrics without
/// one; neither without scored views.
fn summaries(
    job: &ScoringJob,
    outcomes: &[ViewOutcome],
    kind: ViewKind,
) -> (BTreeMap<String, Summary>, Vec<Unavailable>) {
    let scored: Vec<&Vec<Result<f64, Undefined>>> = outcomes
        .iter()
        .filter(|outcome| outcome.view.kind == kind)
        .filter_map(|outcome| outcome.scores.as_ref().ok())
        .collect();
    let (mut summaries, mut unavailable) = (BTreeMap::new(), Vec::new());
    if scored.is_empty() {
        return (summaries, unavailable);
    }
    let mut computed = 0;
    for JobMetric {
        metric,
        unavailable: reason,
    } in &job.metrics
    {
        let summary = match reason {
            Some(reason) => Err(reason.clone()),
            None => {
                let values: Vec<_> = scored.iter().map(|scores| scores[computed]).collect();
                computed += 1;
                summary(metric, &values)
            }
        };
        match summary {
            Ok(summary) => {
                summaries.insert(metric.id.to_owned(), summary);
            }
            Err(reason) => unavailable.push(Unavailable {
                view: kind.to_string(),
                metric: metric.id.to_owned(),
                reason,
            }),
        }
    }
    (summaries, unavailable)
}

/// Returns the summary of a metric's values, of which there is at least one, or the reason for its absence.
pub(crate) fn summary(
    metric: &Metric,
    values: &[Result<f64, Undefined>],
) -> Result<Summary, String> {
    let defined: Vec<f64> = values.iter().filter_map(|value| value.ok()).collect();
    if let (true, Some(Err(reason))) = (defined.is_empty(), values.last()) {
        return Err(format!("undefined for every view: {reason}"));
    }
    let count = defined.len() as f64;
    let mean = defined.iter().sum::<f64>() / count;
    let squares: f64 = defined.iter().map(|value| (value - mean).powi(2)).sum();
    Ok(Summary {
        mean,
        standard_deviation: (defined.len() > 1).then(|| (squares / (count - 1.0)).sqrt()),
        views: defined.len() as u32,
        undefined_views: (values.len() - defined.len()) as u32,
        direction: metric.direction,
    })
}

/// Uses the masks' content: an empty one leaves every pixel to the scores.
fn ignoring_views(outcomes: &[ViewOutcome]) -> Vec<String> {
    let count = outcomes
        .iter()
        .filter(|outcome| outcome.ignores_pixels)
        .count();
    if count == 0 {
        return Vec::new();
    }
    vec![format!(
        "{count} of {} scored views have ignored pixels, which no score counts",
        outcomes.len()
    )]
}

/// Unit of metrics that are infinite for equal images.
const DECIBELS: &str = "dB";

/// Lists views with an infinite PSNR: equal images have no error. They count with the best value of the metric, which
/// readers should know.
fn identical_views(outcomes: &[ViewOutcome]) -> Vec<String> {
    let count = outcomes
        .iter()
        .filter(|outcome| outcome.is_identical)
        .count();
    if count == 0 {
        return Vec::new();
    }
    vec![format!(
        "{count} of {} predictions are the ground truth, byte for byte: their PSNR is infinite and \
         counts as 100 dB",
        outcomes.len()
    )]
}

/// Lists regions of views with an infinite PSNR, of views that are not the ground truth as a whole.
fn identical_regions(job: &ScoringJob, outcomes: &[ViewOutcome]) -> Vec<String> {
    let computed = job.metrics.iter().filter(|one| one.unavailable.is_none());
    let lines = computed.enumerate().filter_map(|(index, JobMetric { metric, .. })| {
        let [_, best] = metric.range;
        let is_best = |outcome: &&ViewOutcome| {
            let scores = outcome.scores.as_ref();
            let score = scores.ok().and_then(|scores| scores.get(index)?.ok());
            !outcome.is_identical && score.is_some_and(|score| score >= best)
        };
        let count = outcomes.iter().filter(is_best).count();
        (metric.unit == DECIBELS && count > 0).then(|| {
            format!(
                "{} of {count} of {} views is infinite, because what it compares is the ground truth, and counts \
                 as {best} dB",
                metric.id,
                outcomes.len()
            )
        })
    });
    lines.collect()
}

/// Returns programs and networks used for scoring.
fn versions(job: &ScoringJob) -> BTreeMap<String, String> {
    let mut versions = provenance::versions();
    for need in job.computed().flat_map(|metric| metric.needs) {
        if let Need::Network(backbone) = need {
            let sha256 = format!("sha256:{}", backbone.weights_sha256());
            versions.insert(backbone.weights().to_owned(), sha256);
        }
    }
    versions
}
