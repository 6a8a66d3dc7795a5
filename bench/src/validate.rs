//! Checking a folder of predictions before it is scored, with the scorer's own code.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{progress::Progress, store};
use rayon::prelude::*;

use crate::{
    error::BenchError,
    loaded_view::LoadedView,
    scoring::job::{ScoringJob, View},
    scoring::{DEFAULT_MEMORY_BYTES, MetricChoice, Predictions, ScoreRequest},
    statement::Statement,
    truth,
};

/// What a check found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValidationReport {
    /// Views that the split asks for, of the kinds that predictions were given for.
    pub views: usize,
    /// Everything that is wrong, in the order of the views, stray files last.
    pub findings: Vec<Finding>,
}

/// Something wrong with a prediction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// `input` or `novel`; `None` for a file of neither.
    pub view: Option<String>,
    /// One line that names the file.
    pub reason: String,
}

/// Checks predictions as scoring will read them, and for what scoring would not notice: images
/// that are black, that are the same for several frames, or that are the ground truth. Notes tell of the scene
/// what is odd of its masks, and which of its images show nothing.
///
/// # Errors
/// Those of [`score`](crate::score()), apart from the output folder.
pub fn validate(
    scene: &Path,
    split: &Path,
    predictions: &Predictions,
    progress: &dyn Progress,
) -> Result<ValidationReport, BenchError> {
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
    let job = ScoringJob::prepare(&request)?;
    let views = job.views();
    progress.begin(
        &format!("checking predictions of {}", job.scene.id),
        Some(views.len() as u64),
    );
    let checked: Vec<Result<Checked, BenchError>> = views
        .par_iter()
        .map(|&view| {
            let checked = LoadedView::read(&job, view).map(|loaded| Checked::of(&loaded));
            progress.advance(1);
            checked
        })
        .collect();
    progress.end();
    let checked = checked.into_iter().collect::<Result<Vec<_>, _>>()?;
    let without_content = checked.iter().filter(|one| one.is_truth_single_colour);
    let without_content = truth::without_content(without_content.map(|one| one.view.frame));
    for line in truth::mask_notes(&job, &views)?
        .into_iter()
        .chain(without_content)
    {
        progress.note(&format!("{}: {line}", job.scene.id));
    }
    let mut findings: Vec<Finding> = checked
        .iter()
        .filter_map(|checked| {
            let reason = checked.problem.clone()?;
            Some(finding(checked.view, reason))
        })
        .collect();
    findings.extend(repetitions(&checked));
    findings.extend(job.strays().map(|name| Finding {
        view: None,
        reason: format!("{name} is of no view that is scored"),
    }));
    Ok(ValidationReport {
        views: views.len(),
        findings,
    })
}

/// What is remembered of a view.
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
                // Where pixels do not count anything may be predicted, the truth among others.
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

/// Predictions that repeat an earlier one although the ground truth does not.
fn repetitions(checked: &[Checked]) -> Vec<Finding> {
    let mut first: BTreeMap<&str, (&View, &str)> = BTreeMap::new();
    let mut findings = Vec::new();
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
            findings.push(finding(
                *view,
                format!(
                    "{name} is the same image as that of {} view {}",
                    earlier.kind, earlier.frame
                ),
            ));
        }
    }
    findings
}
