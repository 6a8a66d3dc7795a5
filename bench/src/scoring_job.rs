//! A scoring request with its files read and checked against each other.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{Resampling, Scene, Split, ValidationStatus},
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    error::BenchError,
    metrics::{self, Metric},
    protocols,
    run_facts::RunFacts,
    scene_identity::SceneIdentity,
    score::{Predictions, ScoreRequest},
    split,
};

/// Whether a method was given a view or had to predict it.
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

/// A view to score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct View {
    pub(crate) kind: ViewKind,
    /// Frame of the scene.
    pub(crate) frame: u32,
}

/// Everything that scoring needs, consistent.
pub(crate) struct ScoringJob {
    pub(crate) method: String,
    pub(crate) scene: Scene,
    pub(crate) split: Split,
    pub(crate) metrics: Vec<&'static Metric>,
    pub(crate) identity: SceneIdentity,
    /// Width and height of the scored images in pixels.
    pub(crate) size: [u32; 2],
    pub(crate) run: Option<RunFacts>,
    scene_file: PathBuf,
    split_file: PathBuf,
    run_file: Option<PathBuf>,
    input_folder: Option<PathBuf>,
    novel_folder: Option<PathBuf>,
    /// PNG files in either folder that are no prediction of the split.
    strays: usize,
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
                let run = RunFacts::read(file)?;
                check_run(file, &run, request, &split)?;
                let (input, novel) = (run.input_folder.clone(), run.novel_folder.clone());
                (Some(file.clone()), Some(run), input, Some(novel))
            }
        };
        if input_folder.is_none() && novel_folder.is_none() {
            return Err(BenchError::NothingToScore);
        }
        for folder in [&input_folder, &novel_folder].into_iter().flatten() {
            if !folder.is_dir() {
                return Err(BenchError::mismatch(
                    folder,
                    "is not a folder of predictions",
                ));
            }
        }
        let strays = count_strays(input_folder.as_deref(), &split.input_views)?
            + count_strays(novel_folder.as_deref(), &split.novel_views)?;
        Ok(Self {
            strays,
            method: request.method.clone(),
            metrics: metrics::of_protocol(&split.protocol)?,
            size: scored_size(&scene, &split)?,
            identity: SceneIdentity::of_split(&request.scene, &scene, &split)?,
            scene,
            split,
            run,
            scene_file: request.scene.clone(),
            split_file: request.split.clone(),
            run_file,
            input_folder,
            novel_folder,
        })
    }

    /// The views to score: input views, then novel views, in the split's order.
    pub(crate) fn views(&self) -> Vec<View> {
        let of = |kind, frames: &[u32], folder: &Option<PathBuf>| {
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

    /// The file that should hold a view's prediction.
    pub(crate) fn prediction_file(&self, view: View) -> PathBuf {
        let folder = match view.kind {
            ViewKind::Input => &self.input_folder,
            ViewKind::Novel => &self.novel_folder,
        };
        folder
            .as_deref()
            .unwrap_or(Path::new(""))
            .join(prediction_name(view.frame))
    }

    /// The file that holds a frame's ground truth.
    pub(crate) fn truth_file(&self, frame: u32) -> PathBuf {
        self.scene_file
            .with_file_name(&self.scene.frames[frame as usize].image)
    }

    /// What a reader of the scores should know beside the numbers.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (kind, folder) in [
            (ViewKind::Input, &self.input_folder),
            (ViewKind::Novel, &self.novel_folder),
        ] {
            if folder.is_none() {
                warnings.push(format!(
                    "{kind} views were not scored: no predictions given"
                ));
            }
        }
        if self.strays > 0 {
            warnings.push(format!(
                "{} PNG files among the predictions belong to no view that was scored",
                self.strays
            ));
        }
        if !self.split.unposed.is_empty() {
            warnings.push(format!(
                "{} of {} frames have no pose and are not scored",
                self.split.unposed.len(),
                self.scene.frames.len()
            ));
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
            warnings.extend(
                run.failure
                    .iter()
                    .map(|failure| format!("the run failed: {failure}")),
            );
            warnings.extend(run.warnings.iter().cloned());
        }
        warnings
    }

    /// The stage with every input: records, ground truth (in the scene's identity), predictions.
    pub(crate) fn stage(&self, out: &Path) -> Result<StagePlan, BenchError> {
        let mut plan = StagePlan::new(out, "score")
            .with_text("method", &self.method)
            .with_text("stray predictions", &self.strays.to_string())
            .with_file(&self.scene_file)?
            .with_hash("frames of the split", self.identity.sha256.clone())
            .with_file(&self.split_file)?;
        plan = match &self.run_file {
            Some(file) => plan.with_file(file)?,
            None => plan.with_text("run record", "none"),
        };
        for view in self.views() {
            let name = format!("{} view {:06}", view.kind, view.frame);
            plan = plan.with_text(
                &format!("{name}, prediction"),
                &fingerprint(&self.prediction_file(view)),
            );
        }
        Ok(plan)
    }
}

/// Counts PNG files that are no prediction of `frames`: a method that numbers its frames in
/// another way should hear of it.
fn count_strays(folder: Option<&Path>, frames: &[u32]) -> Result<usize, StoreError> {
    let Some(folder) = folder else {
        return Ok(0);
    };
    let failed = |source| StoreError::read(folder, source);
    let mut strays = 0;
    for entry in fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let name = name.to_string_lossy();
        let is_png = name.ends_with(".png") && !name.starts_with('.');
        if is_png && !frames.iter().any(|&frame| name == prediction_name(frame)) {
            strays += 1;
        }
    }
    Ok(strays)
}

/// File name of a frame's prediction.
pub(crate) fn prediction_name(frame: u32) -> String {
    format!("{frame:06}.png")
}

/// A prediction's hash, or why it has none: a missing prediction is a state like any other.
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
    for (what, found, expected) in [
        ("method", &run.method, &request.method),
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
    Ok(())
}

/// The scene's size, or the protocol's width with the height in proportion (rounded to nearest).
fn scored_size(scene: &Scene, split: &Split) -> Result<[u32; 2], BenchError> {
    let Resampling::Area = split.protocol.resampling;
    split
        .protocol
        .scored_size(&scene.camera)
        .map_err(|reason| BenchError::Protocol {
            scene: scene.id.clone(),
            protocol: protocols::title(&split.protocol),
            reason,
        })
}
