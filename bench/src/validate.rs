//! Validation of a folder of predictions before scoring, with the scorer's own code.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{progress::Progress, store};
use rayon::prelude::*;

use crate::{
    diagnosis::{self, Diagnosis},
    error::BenchError,
    job::{
        DEFAULT_MEMORY_BYTES, MetricChoice, Predictions, ScoreRequest, ScoringJob, View, ViewKind,
    },
    loaded_view::LoadedView,
    split::without_content,
    statement::Statement,
    truth,
};

/// Result of a validation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValidationReport {
    /// Views of the split, of the kinds with predictions.
    pub views: usize,
    /// All faults: likely mistakes of convention first, then files in the order of the views, stray files last. For a
    /// failed run only the failure: none of its views is read.
    pub findings: Vec<Finding>,
    /// Facts beside the faults of the predictions, one line each: copies of given views, frames of the data that are
    /// given and held out.
    pub notes: Vec<String>,
}

/// A fault of a prediction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// `input` or `novel`; `run` for the run as a whole; `None` for a file of none of them.
    pub view: Option<String>,
    /// One line that names the file, if it has one.
    pub reason: String,
}

/// Checks predictions as scoring will read them, and for faults that scoring would not notice: images that are black,
/// equal for several frames, or equal to the ground truth. Views are also checked for
/// [mistakes of convention](crate::diagnosis). Notes report unusual masks of the scene, and images that show nothing.
///
/// # Errors
/// Those of [`score`](crate::score()), apart from the output folder.
pub fn validate(
    scene: &Path,
    split: &Path,
    predictions: &Predictions,
    progress: &dyn Progress,
) -> Result<ValidationReport, BenchError> {
    let job = job(scene, split, predictions)?;
    let views = job.views();
    let label = format!("checking predictions of {}", job.scene.id);
    let checked = of_views(&job, &label, progress, Checked::of)?;
    let single_colour = checked.iter().filter(|one| one.is_truth_single_colour);
    let empty = without_content(single_colour.map(|one| one.view.frame));
    for line in truth::mask_notes(&job, &views)?.into_iter().chain(empty) {
        progress.note(&format!("{}: {line}", job.scene.id));
    }
    let diagnosis = diagnosis::of_job(&job, DEFAULT_MEMORY_BYTES)?;
    Ok(ValidationReport {
        views: views.len(),
        findings: findings(&job, &diagnosis, &checked),
        notes: diagnosis.notes().map(ToString::to_string).collect(),
    })
}

/// Returns views that the run of a method lacks, or that scoring cannot read, without their pixels being judged.
///
/// # Errors
/// Those of [`validate`].
pub fn unusable_views(
    scene: &Path,
    split: &Path,
    run: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Finding>, BenchError> {
    let job = job(scene, split, &Predictions::Run(run.to_owned()))?;
    let label = format!("reading predictions of {}", job.scene.id);
    let unusable = of_views(&job, &label, progress, |loaded| {
        let reason = loaded.pair.as_ref().err()?;
        Some(finding(loaded.view, reason.clone()))
    })?;
    Ok(unusable.into_iter().flatten().collect())
}

fn job(scene: &Path, split: &Path, predictions: &Predictions) -> Result<ScoringJob, BenchError> {
    let request = match predictions {
        Predictions::Run(run) => ScoreRequest::of_run(scene, split, run, Path::new(""))?,
        Predictions::Folders { .. } => ScoreRequest {
            scene: scene.to_owned(),
            split: split.to_owned(),
            predictions: predictions.clone(),
            method: String::new(),
            statement: Statement::default(),
            out: PathBuf::new(),
            memory_bytes: DEFAULT_MEMORY_BYTES,
            metrics: MetricChoice::All,
        },
    };
    ScoringJob::prepare(&request)
}

/// Reads all views and returns what `of` makes of each, in their order.
fn of_views<T: Send>(
    job: &ScoringJob,
    label: &str,
    progress: &dyn Progress,
    of: impl Fn(&LoadedView) -> T + Sync,
) -> Result<Vec<T>, BenchError> {
    let views = job.views();
    progress.begin(label, Some(views.len() as u64));
    let made: Result<Vec<T>, BenchError> = views
        .par_iter()
        .map(|&view| {
            let made = LoadedView::read(job, view).map(|loaded| of(&loaded));
            progress.advance(1);
            made
        })
        .collect();
    progress.end();
    made
}

/// Returns all faults, in the order of [`ValidationReport::findings`].
fn findings(job: &ScoringJob, diagnosis: &Diagnosis, checked: &[Checked]) -> Vec<Finding> {
    if let Some(failure) = job.run.as_ref().and_then(|run| run.failure.as_ref()) {
        return vec![Finding {
            view: Some("run".to_owned()),
            reason: format!("the run failed: {failure}"),
        }];
    }
    let mut findings: Vec<Finding> = diagnosis
        .mistakes()
        .map(|mistake| Finding {
            view: mistake.view.clone(),
            reason: mistake.without_view(),
        })
        .collect();
    findings.extend(checked.iter().filter_map(|checked| {
        let reason = checked.problem.clone()?;
        Some(finding(checked.view, reason))
    }));
    findings.extend(repetitions(job, checked));
    findings.extend(job.strays().map(|name| Finding {
        view: None,
        reason: format!("{name} is not among the scored views"),
    }));
    findings
}

/// Summary of a checked view.
struct Checked {
    view: View,
    /// Name of its prediction.
    name: String,
    problem: Option<String>,
    is_truth_single_colour: bool,
    /// SHA-256 of the pixels of prediction and ground truth.
    pixels: Option<[String; 2]>,
}

impl Checked {
    fn of(loaded: &LoadedView) -> Self {
        let (problem, pixels) = match &loaded.pair {
            Err(reason) => (Some(reason.clone()), None),
            Ok(pair) => {
                let name = &loaded.name;
                // Pixels that do not count may have any value, the truth among others.
                let problem = if pair.as_predicted().iter().all(|&byte| byte == 0) {
                    Some(format!("{name} is black"))
                } else if pair.prediction() == pair.truth() {
                    Some(format!("{name} is the ground truth, byte for byte"))
                } else {
                    None
                };
                let pixels = [pair.as_predicted(), pair.truth()].map(store::sha256_bytes);
                (problem, Some(pixels))
            }
        };
        Self {
            view: loaded.view,
            name: loaded.name.clone(),
            problem,
            is_truth_single_colour: loaded.is_truth_single_colour,
            pixels,
        }
    }
}

fn finding(view: View, reason: String) -> Finding {
    Finding {
        view: Some(view.kind.to_string()),
        reason,
    }
}

/// Returns predictions that repeat an earlier one although the ground truth does not. Copies of an input view among
/// novel ones make no fault: baselines predict them.
fn repetitions(job: &ScoringJob, checked: &[Checked]) -> Vec<Finding> {
    let mut first: BTreeMap<&str, (&View, &str)> = BTreeMap::new();
    let mut repeated = Vec::new();
    for Checked {
        view, name, pixels, ..
    } in checked
    {
        let Some([prediction, truth]) = pixels else {
            continue;
        };
        let (earlier, true_pixels) = *first
            .entry(prediction.as_str())
            .or_insert((view, truth.as_str()));
        if true_pixels != truth {
            let reason = format!(
                "{name} is the same image as that of {} view {}",
                earlier.kind, earlier.frame
            );
            repeated.push((*view, prediction.as_str(), finding(*view, reason)));
        }
    }
    if !repeated.is_empty() {
        let given = given_images(job);
        repeated.retain(|(view, prediction, _)| {
            view.kind == ViewKind::Input || !given.contains(*prediction)
        });
    }
    repeated.into_iter().map(|(.., finding)| finding).collect()
}

/// Returns the SHA-256 of the pixels of all given views that can be read.
fn given_images(job: &ScoringJob) -> BTreeSet<String> {
    let given = &job.split.input_views;
    given
        .par_iter()
        .filter_map(|&frame| truth::read(job, frame).ok())
        .map(|pixels| store::sha256_bytes(&pixels))
        .collect()
}
