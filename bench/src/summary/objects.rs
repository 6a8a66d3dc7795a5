//! Summaries of single objects: over the views that show each of them.

use omnilife_schemas::{
    object_scores::OBJECT_SCORES_FILE,
    records::{ObjectResult, ObjectResults},
};

use super::summary;
use crate::{
    job::{ScoringJob, ViewKind, ViewOutcome},
    metrics::{Metric, Undefined},
};

const UNSEEN: Undefined = Undefined("the view does not show the object");

/// Summarizes the objects of a job's scene; `None` without a metric of single objects.
pub(super) fn of_job(job: &ScoringJob, outcomes: &[ViewOutcome]) -> Option<ObjectResults> {
    let metrics: Vec<&Metric> = job.of_objects().collect();
    if metrics.is_empty() {
        return None;
    }
    let mut objects = Vec::new();
    for kind in [ViewKind::Input, ViewKind::Novel] {
        let is_scored = |one: &&ViewOutcome| one.view.kind == kind && one.scores.is_ok();
        let scored: Vec<&ViewOutcome> = outcomes.iter().filter(is_scored).collect();
        if scored.is_empty() {
            continue;
        }
        for name in job.scene.object_names() {
            let value = |view: &ViewOutcome, metric: usize| {
                let scores = view.objects.get(name)?;
                scores.get(metric).copied().flatten()
            };
            let scores = metrics.iter().enumerate().filter_map(|(at, metric)| {
                let views = scored.iter().copied();
                let values: Vec<Result<f64, Undefined>> =
                    views.map(|view| value(view, at).ok_or(UNSEEN)).collect();
                Some((metric.id.to_owned(), summary(metric, &values).ok()?))
            });
            objects.push(ObjectResult {
                view: kind.to_string(),
                object: name.to_owned(),
                class: job.scene.class_of(name),
                scores: scores.collect(),
            });
        }
    }
    Some(ObjectResults::new(OBJECT_SCORES_FILE.to_owned(), objects))
}
