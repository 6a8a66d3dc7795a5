//! One method on one scene: from `scene.json` and `split.json` to Gaussians, predicted views, a
//! trace and `run.json`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    lock::FolderLock,
    progress::Progress,
    provenance,
    records::{RunRecord, Scene, Split, ViewPredictions},
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    error::ReconstructError,
    formats::{DEFORMATION_FILE, GAUSSIANS_FILE, MOVING_GAUSSIANS_FILE, REFINED_POSES_FILE},
    methods::{self, MethodOutcome, feed_forward},
    process::{self, Elapsed},
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    train::{Session, TrainingFiles, trace},
};
use omnilife_engine::training_view::TrainingView;

/// Name of the record in the run's folder.
pub const RUN_FILE: &str = "run.json";
/// Name of the checkpoint in the run's folder; it is there while a run is not over.
pub const CHECKPOINT_FILE: &str = "checkpoint.bin";
const TRACE_FILE: &str = "trace.csv";
const INPUT_FOLDER: &str = "predictions/input";
pub(crate) const NOVEL_FOLDER: &str = "predictions/novel";

/// What to reconstruct, how, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructRequest {
    /// The scene.
    pub scene: PathBuf,
    /// Its split.
    pub split: PathBuf,
    /// Name of the method.
    pub method: String,
    /// What is asked of it.
    pub settings: MethodRequest,
    /// What computes.
    pub backend: BackendChoice,
    /// Iterations between two checkpoints; 0 writes none.
    pub checkpoint_every: u64,
    /// Folder of the run.
    pub out: PathBuf,
}

/// Checks that there is such a method, and that what is asked of it makes sense.
///
/// # Errors
/// When there is none, or it has no such component or backend.
pub fn check(
    method: &str,
    settings: &MethodRequest,
    backend: BackendChoice,
) -> Result<(), ReconstructError> {
    match feed_forward::find(method) {
        Some(interpolator) => crate::jobs::interpolate::check(interpolator, settings, backend),
        None => methods::find(method)?.check(settings),
    }
}

/// Runs one method on one scene, or returns the stored record when nothing has changed. A run that
/// was interrupted goes on from its checkpoint. Interpolators learn nothing and leave no Gaussians,
/// trace or input views.
///
/// # Errors
/// When the scene cannot be loaded, the request makes no sense for the method, training diverges,
/// the checkpoint is damaged, a file that no run has made is in the way, or one cannot be written.
pub fn reconstruct(
    request: &ReconstructRequest,
    progress: &dyn Progress,
) -> Result<RunRecord, ReconstructError> {
    if let Some(interpolator) = feed_forward::find(&request.method) {
        return crate::jobs::interpolate::interpolate(interpolator, request, progress);
    }
    let method = methods::find(&request.method)?;
    method.check(&request.settings)?;
    let (stage, inputs) = plan_stage(request)?;
    let record_path = request.out.join(RUN_FILE);
    if stage.is_done() {
        progress.note(&format!(
            "reconstruct {} with {}: unchanged, skipped",
            request.scene.display(),
            method.id
        ));
        return Ok(store::read_record(&record_path)?);
    }
    let _lock = FolderLock::take(&request.out, progress)?;
    let split: Split = store::read_record(&request.split)?;
    stage.claim(planned_files(&split))?;
    // A record or trace of an earlier run must not stand beside new predictions.
    store::remove(&record_path)?;
    let trace_path = request.out.join(TRACE_FILE);
    store::remove(&trace_path)?;
    let begun = Instant::now();
    let scene = TrainingScene::load(&request.scene, &request.split)?;
    let checkpoint = request.out.join(CHECKPOINT_FILE);
    let session = Session {
        progress,
        files: Some(TrainingFiles {
            trace: trace_path.clone(),
            checkpoint: checkpoint.clone(),
            checkpoint_every: request.checkpoint_every,
            inputs_sha256: stage.inputs_sha256(),
        }),
        backend: request.backend,
        planning: Elapsed::default(),
    };
    let mut outcome = method.train(&scene, &request.settings, &session)?;
    let rendering = Instant::now();
    let mut outputs = render_predictions(&scene, &mut outcome, &stage, &request.out, progress)?;
    let rendering_seconds = rendering.elapsed().as_secs_f64();
    let training = &outcome.training;
    let learner = &mut outcome.learner;
    let gaussians = learner.size().primitives;
    outputs.extend(learner.export(&request.out)?);
    trace::write_csv(&trace_path, &training.state.trace)?;
    let evidence = outcome.evidence.as_ref().map(serde_json::to_value);
    let evidence = evidence
        .transpose()
        .map_err(|error| StoreError::write(&record_path, std::io::Error::other(error)))?;
    let record = RunRecord {
        method: method.id.to_owned(),
        scene: scene.id.clone(),
        protocol_hash: split.protocol_hash.clone(),
        seed: request.settings.seed,
        backend: learner.backend(),
        configuration: outcome.configuration.clone(),
        plan: outcome.plan.clone(),
        evidence,
        hardware: Some(provenance::Hardware::here()),
        versions: provenance::versions(),
        inputs,
        iterations: training.state.iteration,
        gaussians,
        planning_seconds: outcome.planning.wall.as_secs_f64(),
        planning_cpu_seconds: outcome.planning.cpu.map(|time| time.as_secs_f64()),
        training_seconds: training.state.training.as_secs_f64(),
        training_cpu_seconds: training.state.training_cpu.map(|time| time.as_secs_f64()),
        evaluation_seconds: training.state.evaluation.as_secs_f64(),
        rendering_seconds,
        seconds_per_group: None,
        peak_memory_bytes: process::peak_memory_bytes(),
        normalization: scene.normalization,
        trace: Some(TRACE_FILE.to_owned()),
        predictions: ViewPredictions {
            input_views: Some(INPUT_FOLDER.to_owned()),
            novel_views: NOVEL_FOLDER.to_owned(),
        },
        warnings: warnings(&scene, &split, &outcome),
    };
    store::write_record(&record_path, &record)?;
    outputs.extend([RUN_FILE, TRACE_FILE].map(str::to_owned));
    stage.finish(outputs, begun.elapsed().as_secs_f64())?;
    store::remove(&checkpoint)?;
    Ok(record)
}

/// What a run may leave, relative to its folder; its checkpoint goes at the end.
fn planned_files(split: &Split) -> impl Iterator<Item = String> + '_ {
    let views = [
        (INPUT_FOLDER, &split.input_views),
        (NOVEL_FOLDER, &split.novel_views),
    ];
    let views = views
        .into_iter()
        .flat_map(|(folder, frames)| frames.iter().map(move |&frame| view_file(folder, frame)));
    [
        RUN_FILE,
        TRACE_FILE,
        GAUSSIANS_FILE,
        MOVING_GAUSSIANS_FILE,
        DEFORMATION_FILE,
        REFINED_POSES_FILE,
        CHECKPOINT_FILE,
    ]
    .map(str::to_owned)
    .into_iter()
    .chain(views)
}

/// The file of a predicted view, relative to the run's folder.
pub(crate) fn view_file(folder: &str, frame: u32) -> String {
    format!("{folder}/{frame:06}.png")
}

/// The stage with its inputs, and the inputs' hashes by name for the record.
pub(crate) fn plan_stage(
    request: &ReconstructRequest,
) -> Result<(StagePlan, BTreeMap<String, String>), ReconstructError> {
    let scene: Scene = store::read_record(&request.scene)?;
    let folder = request.scene.parent().unwrap_or(Path::new("."));
    let mut stage = StagePlan::new(&request.out, "reconstruct")
        .with_text("method", &request.method)
        .with_settings("settings", &request.settings)
        .with_settings("backend", &request.backend);
    let mut inputs = BTreeMap::new();
    let mut add = |stage: StagePlan, name: &str, path: &Path| -> Result<StagePlan, StoreError> {
        let hash = store::sha256_file(path)?;
        inputs.insert(name.to_owned(), hash.clone());
        Ok(stage.with_hash(name, hash))
    };
    stage = add(stage, "scene.json", &request.scene)?;
    stage = add(stage, "split.json", &request.split)?;
    if let Some(points) = &scene.points {
        stage = add(stage, points, &folder.join(points))?;
    }
    for frame in &scene.frames {
        stage = add(stage, &frame.image, &folder.join(&frame.image))?;
        if let Some(mask) = &frame.mask {
            stage = add(stage, mask, &folder.join(mask))?;
        }
    }
    Ok((stage, inputs))
}

/// Renders all views of the split; returns the files relative to the run's folder.
fn render_predictions(
    scene: &TrainingScene,
    outcome: &mut MethodOutcome<'_>,
    stage: &StagePlan,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let learner = &mut outcome.learner;
    let total = scene.input_views.len() + scene.novel_views.len();
    progress.begin("rendering", Some(total as u64));
    let mut files = Vec::with_capacity(total);
    let mut render = |views: &[TrainingView], name: &str| -> Result<(), ReconstructError> {
        prepare_predictions(stage, out, name)?;
        for view in views {
            let file = view_file(name, view.frame);
            let image = learner.image(&view.view)?;
            image.write_png(&out.join(&file))?;
            files.push(file);
            progress.advance(1);
        }
        Ok(())
    };
    let outcome = render(&scene.input_views, INPUT_FOLDER)
        .and_then(|()| render(&scene.novel_views, NOVEL_FOLDER));
    progress.end();
    outcome.map(|()| files)
}

/// Makes a folder of views, and removes those of an earlier run, which another split would score by
/// mistake, and nothing else.
pub(crate) fn prepare_predictions(
    stage: &StagePlan,
    out: &Path,
    folder: &str,
) -> Result<(), StoreError> {
    let is_view = |file: &str| file.rsplit_once('/').is_some_and(|(of, _)| of == folder);
    stage.own_files().remove(is_view)?;
    store::create_folder(&out.join(folder))
}

fn warnings(scene: &TrainingScene, split: &Split, outcome: &MethodOutcome<'_>) -> Vec<String> {
    let training = &outcome.training;
    let mut warnings = training.remarks.clone();
    if split.groups.len() > 1 {
        warnings.push(format!(
            "one model was trained on the given views of all {} groups at once",
            split.groups.len()
        ));
    }
    let masked = scene
        .input_views
        .iter()
        .filter(|view| view.mask.is_some())
        .count();
    if masked > 0 && masked < scene.input_views.len() && outcome.learner.size().with_times > 0 {
        warnings.push(format!(
            "{} of {} input views have no mask; nothing is known of what moves in them",
            scene.input_views.len() - masked,
            scene.input_views.len()
        ));
    }
    if scene.points.is_empty() {
        warnings
            .push("the scene has no points; training began from the sky shell alone".to_owned());
    }
    warnings.extend(outcome.learner.warnings());
    if scene.is_normalized_by_points {
        warnings.push(
            "the cameras hardly move in a scene of this size; it is normalized by its points"
                .to_owned(),
        );
    }
    let refused: u64 = training.state.refused.iter().sum();
    if refused > 0 {
        warnings.push(format!(
            "{refused} gradient values were not finite and were not applied; the trace counts them \
             by array"
        ));
    }
    if training.stopped_by_budget {
        warnings.push(format!(
            "the time budget ended training after {} of {} iterations",
            training.state.iteration, outcome.iterations
        ));
    }
    warnings
}
