//! A scoring request with its files read and checked against each other.

mod choice;
mod needs;

use std::{
    collections::BTreeMap,
    fmt,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    plain_text,
    records::{Scene, Split, ValidationStatus},
    stage::StagePlan,
    store::{self, StoreError},
    tracked_regions::TrackedRegions,
};

use crate::{
    availability,
    curve::rows::Trace,
    error::BenchError,
    metrics::{self, Metric, Need, Undefined},
    prediction::PredictionFolder,
    run_facts::{self, RunFacts},
    scene_identity::SceneIdentity,
    split,
    statement::Statement,
};
pub use choice::MetricChoice;

/// Folder of the predictions: `<folder>/<frame, 6 digits>.png`, 8-bit RGB at the protocol's size (padded frames with or
/// without the padding). Or the same name with `.npy` for values in [0, 1] of shape (height, width, 3). Frame numbers
/// are those of the split.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Predictions {
    /// Folders from any method. A kind of view without a folder is not scored, and the result says so; at least one is
    /// needed.
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

/// Input and options of scoring.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreRequest {
    /// The `scene.json` with the ground truth.
    pub scene: PathBuf,
    /// The `split.json` of that scene; it holds the protocol.
    pub split: PathBuf,
    /// The predictions.
    pub predictions: Predictions,
    /// Id of the method in the tables.
    pub method: String,
    /// Facts about the run that are not in its record.
    pub statement: Statement,
    /// Folder for `result.json`, `scoring.json`, `frames.csv` and `comparisons/`; created if missing.
    pub out: PathBuf,
    /// Approximate limit of the memory of all views, bytes. It determines how many are scored at once, at least one,
    /// and changes no score.
    pub memory_bytes: u64,
    /// Metrics to compute.
    pub metrics: MetricChoice,
}

/// Default memory limit of scoring: 2 GB.
pub const DEFAULT_MEMORY_BYTES: u64 = 2_000_000_000;

impl ScoreRequest {
    /// Creates a request for a run, with the method's id from its record.
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
            statement: Statement::default(),
            out: out.to_owned(),
            memory_bytes: DEFAULT_MEMORY_BYTES,
            metrics: MetricChoice::All,
        })
    }
}

/// Kind of a view: given to a method or predicted by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewKind {
    Input,
    Novel,
}

impl fmt::Display for ViewKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Input => "input",
            Self::Novel => "novel",
        })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct View {
    pub(crate) kind: ViewKind,
    pub(crate) frame: u32,
}

pub(crate) struct ViewOutcome {
    pub(crate) view: View,
    /// One value per available metric of the protocol, or the reason for their absence.
    pub(crate) scores: Result<Vec<Result<f64, Undefined>>, String>,
    /// Scores of the objects in it by their names: one value per metric of [`ScoringJob::of_objects`].
    pub(crate) objects: BTreeMap<String, Vec<Option<f64>>>,
    /// True if the prediction is the ground truth, byte for byte.
    pub(crate) is_identical: bool,
    /// True if a mask marks any of its pixels as outside the scene.
    pub(crate) ignores_pixels: bool,
    /// True if the ground truth shows nothing.
    pub(crate) is_truth_single_colour: bool,
    /// Comparison image relative to the output folder.
    pub(crate) comparison: Option<String>,
}

/// Identity of a score: kind of view, metric id and frame.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ScoreKey {
    pub(crate) view: String,
    pub(crate) metric: String,
    pub(crate) frame: u32,
}

impl ScoreKey {
    /// Returns true for a score of this kind of view and metric.
    pub(crate) fn is_of(&self, view: &str, metric: &str) -> bool {
        self.view == view && self.metric == metric
    }
}

/// Consistent inputs of scoring.
pub(crate) struct ScoringJob {
    pub(crate) method: String,
    pub(crate) statement: Statement,
    pub(crate) scene: Scene,
    pub(crate) split: Split,
    /// The metrics of the protocol, in its order.
    pub(crate) metrics: Vec<JobMetric>,
    pub(crate) identity: SceneIdentity,
    /// Width and height of the scored images in pixels.
    pub(crate) size: [u32; 2],
    pub(crate) run: Option<RunFacts>,
    /// Moving regions, if the scene has no masks of them and tracks lie beside the split.
    pub(crate) regions: Option<TrackedRegions>,
    scene_file: PathBuf,
    split_file: PathBuf,
    run_file: Option<PathBuf>,
    input_folder: Option<PredictionFolder>,
    novel_folder: Option<PredictionFolder>,
}

pub(crate) struct JobMetric {
    pub(crate) metric: &'static Metric,
    /// Reason why it cannot be computed for any view.
    pub(crate) unavailable: Option<String>,
}

impl ScoringJob {
    /// Reads the request's records and checks that they belong together.
    pub(crate) fn prepare(request: &ScoreRequest) -> Result<Self, BenchError> {
        let scene: Scene = store::read_record(&request.scene)?;
        let split: Split = store::read_record(&request.split)?;
        split::check_split(&request.split, &split, &scene)?;
        let (run_file, run, input_folder, novel_folder) = match &request.predictions {
            Predictions::Folders {
                input_views,
                novel_views,
            } => (None, None, input_views.clone(), novel_views.clone()),
            Predictions::Run(file) => {
                let mut run = RunFacts::read(file)?;
                check_run(file, &run, request, &split)?;
                run.note_other_inputs(&request.scene)?;
                run.note_changed_views(file)?;
                let (input, novel) = (run.input_folder.clone(), run.novel_folder.clone());
                (Some(file.clone()), Some(run), input, Some(novel))
            }
        };
        let run_with_file = run_file.as_deref().zip(run.as_ref());
        request.statement.check(run_with_file)?;
        let scored = split.protocol.scored;
        let input_folder = input_folder.filter(|_| scored.has_input());
        let novel_folder = novel_folder.filter(|_| scored.has_novel());
        if input_folder.is_none() && novel_folder.is_none() {
            return Err(BenchError::NothingToScore);
        }
        let refusal = (run.as_ref())
            .and_then(|run| run.failure.as_ref())
            .map(|failure| format!("the run failed: {failure}"));
        for folder in [&input_folder, &novel_folder].into_iter().flatten() {
            if run.is_none() {
                run_facts::refuse_views_of_other_runs(folder)?;
            }
            if !folder.is_dir() && refusal.is_none() {
                return Err(BenchError::mismatch(
                    folder,
                    "is not a folder of predictions",
                ));
            }
        }
        let (size, padded) = split::sizes(&scene, &split)?;
        let open = |folder: Option<PathBuf>, frames: &[u32]| {
            folder
                .map(|folder| match &refusal {
                    Some(reason) => Ok(PredictionFolder::refused(&folder, Some(reason.clone()))),
                    None => PredictionFolder::open(&folder, frames)
                        .map(|folder| folder.in_frames(padded)),
                })
                .transpose()
        };
        let input_folder = open(input_folder, &split.input_views)?;
        let novel_folder = open(novel_folder, &split.novel_views)?;
        let asked = metrics::of_protocol(&split.protocol)?;
        let needs: Vec<Need> = asked
            .iter()
            .flat_map(|metric| metric.needs)
            .copied()
            .collect();
        let has_depth = [&input_folder, &novel_folder]
            .into_iter()
            .flatten()
            .any(PredictionFolder::has_depth);
        let regions = if needs.contains(&Need::DynamicMask) {
            let beside = request.split.parent().unwrap_or(Path::new(""));
            TrackedRegions::find(&scene, beside)?
        } else {
            None
        };
        let metrics = asked
            .into_iter()
            .map(|metric| {
                // Omitted metrics need no weights.
                let unavailable = match request.metrics.why_not(metric) {
                    Some(reason) => Some(reason),
                    None => {
                        availability::why_not(metric, &scene, &split, regions.is_some(), has_depth)?
                    }
                };
                Ok(JobMetric {
                    metric,
                    unavailable,
                })
            })
            .collect::<Result<_, BenchError>>()?;
        Ok(Self {
            method: request.method.clone(),
            statement: request.statement.clone(),
            metrics,
            size,
            identity: SceneIdentity::of_split(&request.scene, &scene, &split, &needs)?,
            scene,
            split,
            run,
            regions,
            scene_file: request.scene.clone(),
            split_file: request.split.clone(),
            run_file,
            input_folder,
            novel_folder,
        })
    }

    /// Returns the views to score: input views, then novel views, in the split's order. Views that the protocol does
    /// not score are omitted, even with predictions.
    pub(crate) fn views(&self) -> Vec<View> {
        let of = |kind, frames: &[u32], folder: &Option<PredictionFolder>| {
            let count = if folder.is_some() { frames.len() } else { 0 };
            frames[..count]
                .iter()
                .map(move |&frame| View { kind, frame })
                .collect::<Vec<_>>()
        };
        let mut views = of(ViewKind::Input, &self.split.input_views, &self.input_folder);
        views.extend(of(
            ViewKind::Novel,
            &self.split.novel_views,
            &self.novel_folder,
        ));
        views
    }

    pub(crate) fn folder(&self, kind: ViewKind) -> Option<&PredictionFolder> {
        match kind {
            ViewKind::Input => self.input_folder.as_ref(),
            ViewKind::Novel => self.novel_folder.as_ref(),
        }
    }

    /// Returns images among the predictions that belong to no scored view.
    pub(crate) fn strays(&self) -> impl Iterator<Item = &str> {
        let folders = self.folders();
        folders.flat_map(|folder| folder.strays.iter().map(String::as_str))
    }

    /// Returns images of predicted frames in a format that is not read.
    fn unread(&self) -> impl Iterator<Item = &str> {
        let folders = self.folders();
        folders.flat_map(|folder| folder.unread.iter().map(String::as_str))
    }

    fn folders(&self) -> impl Iterator<Item = &PredictionFolder> {
        [&self.input_folder, &self.novel_folder]
            .into_iter()
            .flatten()
    }

    pub(crate) fn scene_file(&self, name: &str) -> PathBuf {
        self.scene_file.with_file_name(name)
    }

    /// Returns warnings for readers of the scores.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let scored = self.split.protocol.scored;
        for (kind, folder, is_scored) in [
            (ViewKind::Input, &self.input_folder, scored.has_input()),
            (ViewKind::Novel, &self.novel_folder, scored.has_novel()),
        ] {
            if is_scored && folder.is_none() {
                warnings.push(format!(
                    "{kind} views were not scored: no predictions given"
                ));
            }
        }
        let strays = self.strays().count();
        if strays > 0 {
            warnings.push(format!(
                "the predictions hold {} beyond the scored views",
                plain_text::counted(strays, "image")
            ));
        }
        let unread: Vec<String> = self.unread().map(str::to_owned).collect();
        if !unread.is_empty() {
            warnings.push(format!(
                "only PNG and .npy are read, not these beside predictions: {}",
                plain_text::first_of(&unread)
            ));
        }
        if !self.split.unposed.is_empty() {
            warnings.push(format!(
                "{} of {} frames have no pose and are not scored",
                self.split.unposed.len(),
                self.scene.frames.len()
            ));
        }
        warnings.extend(self.split.notes(&self.scene));
        if self.regions.is_some() && self.needs(Need::DynamicMask) {
            warnings.push(
                "static and dynamic regions are by the boxes that tracking found, not by masks of the scene"
                    .to_owned(),
            );
        }
        match self.scene.validation.status {
            ValidationStatus::Valid => {}
            ValidationStatus::Unstable => warnings.push(format!(
                "the scene's poses are unstable: {}",
                self.scene.validation.problems.join("; ")
            )),
            ValidationStatus::Unchecked => {
                warnings.push("the scene's poses were given and not checked".to_owned());
            }
        }
        if let Some(run) = &self.run {
            warnings.extend(run.warnings.iter().cloned());
        }
        warnings
    }

    /// Returns the stage with every input: records, ground truth (in the scene's identity), predictions.
    pub(crate) fn stage(&self, out: &Path) -> Result<StagePlan, BenchError> {
        let mut plan = StagePlan::new(out, "score")
            .with_text("method", &self.method)
            .with_text("statement", &format!("{:?}", self.statement))
            .with_text(
                "stray predictions",
                &(self.strays().chain(self.unread()))
                    .collect::<Vec<_>>()
                    .join(", "),
            )
            .with_file(&self.scene_file)?
            .with_hash("frames of the split", self.identity.sha256.clone())
            .with_file(&self.split_file)?;
        plan = match &self.run_file {
            Some(file) => plan.with_file(file)?,
            None => plan.with_text("run record", "none"),
        };
        if let Some(regions) = &self.regions {
            plan = plan.with_hash("tracks of the regions", regions.sha256.clone());
        }
        for JobMetric {
            metric,
            unavailable,
        } in &self.metrics
        {
            let state = unavailable.as_deref().unwrap_or("available");
            plan = plan.with_text(&format!("metric {}", metric.id), state);
        }
        let trace = self.run.as_ref().and_then(|run| run.trace.as_ref());
        for file in trace.into_iter().flat_map(Trace::files) {
            plan = plan.with_text("view along the training", &fingerprint(&file));
        }
        let with_depth = self.needs(Need::Depth);
        for view in self.views() {
            let Some(folder) = self.folder(view.kind) else {
                continue;
            };
            let name = format!("{} view {:06}", view.kind, view.frame);
            let files = folder.files(view.frame).map(|file| fingerprint(&file));
            plan = plan.with_text(&format!("{name}, prediction"), &files.join(", "));
            if with_depth {
                let file = folder.depth_file(view.frame);
                plan = plan.with_text(&format!("{name}, depth"), &fingerprint(&file));
            }
        }
        Ok(plan)
    }
}

/// Returns a prediction's hash, or the reason without one: a missing prediction is a state like any other.
fn fingerprint(file: &Path) -> String {
    match store::sha256_file(file) {
        Ok(sha256) => sha256,
        Err(StoreError::Read { source, .. }) => format!("unreadable: {}", source.kind()),
        Err(_) => "unreadable".to_owned(),
    }
}

fn check_run(
    file: &Path,
    run: &RunFacts,
    request: &ScoreRequest,
    split: &Split,
) -> Result<(), BenchError> {
    if request.method != run.method {
        return Err(BenchError::mismatch(
            file,
            format!("is of method {}, not {}", run.method, request.method),
        ));
    }
    for (what, found, expected) in [
        ("scene", &run.scene, &split.scene),
        ("protocol hash", &run.protocol_hash, &split.protocol_hash),
    ] {
        if found != expected {
            return Err(BenchError::mismatch(
                file,
                format!("is of {what} {found}, not {expected}"),
            ));
        }
    }
    // The frames held out in training must be those scored as held out.
    let given = store::sha256_file(&request.split)?;
    if let Some(trained) = run.split_sha256.as_ref().filter(|sha256| **sha256 != given) {
        return Err(BenchError::mismatch(
            file,
            format!(
                "was made by another split (sha256 {trained:.12}) than {} ({given:.12})",
                request.split.display()
            ),
        ));
    }
    Ok(())
}
