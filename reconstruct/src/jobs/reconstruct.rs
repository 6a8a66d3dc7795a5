//! One method on one scene: from `scene.json` and `split.json` to Gaussians, predicted views, a
//! trace and `run.json`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Similarity,
    elapsed::{Elapsed, Stopwatch},
    layout::{RUN_FILE, TRACKS_FILE},
    progress::Progress,
    provenance,
    records::{
        Backend, ComponentDecision, Edits, PoseSource, RunRecord, Scene, Split, SurfaceFaults,
        TraceViews as KeptViews, ViewPredictions,
    },
    scene_points::ScenePoints,
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    backends, components,
    error::ReconstructError,
    jobs::{
        interpolate::{Frames, GROUPS_FILE},
        stage_times,
        trace_folder::{self, TRACE_FOLDER},
    },
    methods::{
        self, Method, MethodKind, MethodOutcome, requirement::Requirement, variant::Variant,
    },
    models::run_views,
    process,
    request::{BackendChoice, MethodRequest},
    scene::{self, TrainingScene},
    train::{Session, TrainingFiles, trace, trace_views::TraceViews},
};
use omnilife_engine::training_view::TrainingView;

/// Name of the checkpoint in the run's folder; it is there while a run is not over.
pub const CHECKPOINT_FILE: &str = "checkpoint.bin";
/// What became of lifted pixels, in the folder of a run that began with them.
pub const LIFT_FILE: &str = "lift.json";
const TRACE_FILE: &str = "trace.csv";
/// Files of a training beside views, the record and the model.
const TRAINING_FILES: [&str; 3] = [TRACE_FILE, LIFT_FILE, CHECKPOINT_FILE];
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
    /// Novel views that are kept at each row of the trace, at most; all where none is given.
    pub trace_views: Option<usize>,
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
    methods::find(method)?.check(settings, backend)
}

/// What a method made of a scene, as far as its kind decides it.
pub(crate) struct MadeViews {
    pub(crate) backend: Backend,
    /// Every setting as resolved.
    pub(crate) configuration: serde_json::Value,
    pub(crate) plan: Vec<ComponentDecision>,
    /// What the scene showed of itself, where the method asked.
    pub(crate) evidence: Option<serde_json::Value>,
    /// What deciding and placing first primitives took; part of the training's time.
    pub(crate) planning: Elapsed,
    pub(crate) iterations: u64,
    pub(crate) primitives: u64,
    pub(crate) training_seconds: f64,
    pub(crate) training_cpu_seconds: Option<f64>,
    pub(crate) evaluation_seconds: f64,
    pub(crate) rendering: Elapsed,
    pub(crate) seconds_per_group: Option<f64>,
    pub(crate) normalization: Similarity,
    pub(crate) trace: Option<String>,
    pub(crate) trace_views: Option<KeptViews>,
    pub(crate) surfaces: Option<SurfaceFaults>,
    pub(crate) predictions: ViewPredictions,
    pub(crate) warnings: Vec<String>,
    /// Files relative to the run's folder.
    pub(crate) outputs: Vec<String>,
}

/// Runs one method on one scene, or returns the stored record when nothing has changed. A training
/// that was interrupted goes on from its checkpoint. Feed-forward methods learn nothing and leave no
/// model, trace or input views.
///
/// # Errors
/// When the scene cannot be loaded, the request makes no sense for the method, training diverges,
/// the checkpoint is damaged, a file that no run has made is in the way, or one cannot be written.
pub fn reconstruct(
    request: &ReconstructRequest,
    progress: &dyn Progress,
) -> Result<RunRecord, ReconstructError> {
    let method = methods::find(&request.method)?;
    method.check(&request.settings, request.backend)?;
    let scene: Scene = store::read_record(&request.scene)?;
    refuse_without_parallax(method, &scene)?;
    let split: Split = store::read_record(&request.split)?;
    let (stage, inputs) = plan_stage(request, &scene)?;
    let record_path = request.out.join(RUN_FILE);
    if stage.is_done() {
        progress.note(&format!(
            "reconstruct {} with {}: unchanged, skipped",
            request.scene.display(),
            method.id
        ));
        return Ok(store::read_record(&record_path)?);
    }
    backends::check(request.backend)?;
    stage.refuse_foreign_folder(TRACE_FOLDER)?;
    let planned = planned_files(method, &split);
    let record = stage.run(planned, progress, |out| -> Result<_, ReconstructError> {
        trace_folder::remove_abandoned(&request.out)?;
        // A record or trace of an earlier run must not stand beside new predictions.
        store::remove(&record_path)?;
        store::remove(&request.out.join(TRACE_FILE))?;
        let mut notes = scene::mask_notes(&request.scene, &request.split)?;
        notes.extend(scene.far_frames());
        for line in &notes {
            progress.note(line);
        }
        let mut made = match method.kind {
            MethodKind::Trained { .. } => train(method, request, &split, &stage, progress)?,
            MethodKind::FeedForward {
                settings,
                interpolate,
            } => {
                let frames = Frames::new(request, &scene, &split)?;
                frames.make_views(method.id, settings(), interpolate, &stage, progress)?
            }
        };
        made.warnings.extend(notes);
        let mut stages = stage_times::of_request(request, method, &scene)?;
        stages.extend(stage_times::of_run(
            made.planning,
            Elapsed {
                wall_seconds: made.training_seconds,
                cpu_seconds: made.training_cpu_seconds,
            },
            made.rendering,
        ));
        let can_be_edited = method.model().is_some_and(|model| model.edit.is_some());
        let variant = Variant::of(method, &request.settings).to_string();
        let record = RunRecord {
            method: method.id.to_owned(),
            variant: (variant != method.id).then_some(variant),
            scene: scene.id.clone(),
            protocol_hash: split.protocol_hash.clone(),
            seed: request.settings.seed,
            backend: made.backend,
            configuration: made.configuration,
            plan: made.plan,
            evidence: made.evidence,
            planning_seconds: made.planning.wall_seconds,
            planning_cpu_seconds: made.planning.cpu_seconds,
            hardware: Some(provenance::Hardware::here()),
            versions: provenance::versions(),
            inputs,
            iterations: made.iterations,
            primitives: made.primitives,
            training_seconds: made.training_seconds,
            training_cpu_seconds: made.training_cpu_seconds,
            evaluation_seconds: made.evaluation_seconds,
            rendering_seconds: made.rendering.wall_seconds,
            stages,
            seconds_per_group: made.seconds_per_group,
            peak_memory_bytes: process::peak_memory_bytes(),
            normalization: made.normalization,
            up: run_views::up(&scene, &split),
            clip_seconds: run_views::clip_seconds(&scene, &split),
            views: can_be_edited.then(|| run_views::poses(&scene, &split)),
            trace: made.trace,
            trace_views: made.trace_views,
            surfaces: made.surfaces,
            predictions: made.predictions,
            warnings: made.warnings,
            edits: Edits::default(),
        };
        out.add_all(made.outputs);
        out.write_record(RUN_FILE, &record)?;
        Ok(record)
    })?;
    store::remove(&request.out.join(CHECKPOINT_FILE))?;
    Ok(record)
}

/// Refuses a scene whose camera turns where it stands to a method that needs places in space.
fn refuse_without_parallax(method: &Method, scene: &Scene) -> Result<(), ReconstructError> {
    if method.needs(Requirement::Parallax)
        && let PoseSource::Registered { reason, .. } = &scene.pose_source
    {
        let reason = format!(
            "{}: the camera of {} hovers or turns ({reason}): without parallax there are tracks (`omnilife curate \
             tracks`), and nothing can be reconstructed",
            method.id, scene.id
        );
        return Err(ReconstructError::Request { reason });
    }
    Ok(())
}

/// Trains a method, and leaves its model, views and trace in the run's folder.
fn train(
    method: &Method,
    request: &ReconstructRequest,
    split: &Split,
    stage: &StagePlan,
    progress: &dyn Progress,
) -> Result<MadeViews, ReconstructError> {
    let trace_path = request.out.join(TRACE_FILE);
    let mut scene = TrainingScene::load(&request.scene, &request.split, method.camera_extent())?;
    let begun = Stopwatch::of_own_process();
    progress.begin("completing points", None);
    let points = components::complete_points(&mut scene, method.supported(), &request.settings);
    progress.end();
    let planning = begun.elapsed();
    let kept = TraceViews::new(
        request.out.join(TRACE_FOLDER),
        &split.novel_views,
        request.trace_views,
    );
    let session = Session {
        progress,
        files: Some(TrainingFiles {
            trace: trace_path.clone(),
            trace_views: Some(kept.clone()),
            checkpoint: request.out.join(CHECKPOINT_FILE),
            checkpoint_every: request.checkpoint_every,
            inputs_sha256: stage.inputs_sha256(),
        }),
        backend: request.backend,
        planning,
    };
    let mut outcome = method.train(&scene, &request.settings, &session)?;
    let rendering = Stopwatch::of_own_process();
    let mut outputs = render_predictions(&scene, &mut outcome, stage, &request.out, progress)?;
    let rendering = rendering.elapsed();
    let warnings = warnings(&scene, split, &outcome);
    let lift_path = request.out.join(LIFT_FILE);
    match &outcome.lift {
        Some(lift) => {
            store::write_record(&lift_path, lift)?;
            outputs.push(LIFT_FILE.to_owned());
        }
        None => store::remove(&lift_path)?,
    }
    let (training, learner) = (&outcome.training, &mut outcome.learner);
    let model = learner.export(&request.out)?;
    let obsolete =
        |file: &str| methods::model_files().contains(file) && !model.iter().any(|new| new == file);
    stage.own_files().remove(obsolete)?;
    outputs.extend(model);
    trace::write_csv(&trace_path, &training.state.trace)?;
    let evidence = outcome.evidence.as_ref().map(serde_json::to_value);
    let evidence = evidence.transpose().map_err(|error| {
        StoreError::write(&request.out.join(RUN_FILE), std::io::Error::other(error))
    })?;
    outputs.push(TRACE_FILE.to_owned());
    outputs.extend(trace_folder::files(&training.state.trace, &kept.frames));
    // Views of an earlier run's rows.
    stage
        .own_files()
        .remove(|file| trace_folder::holds(file) && !outputs.iter().any(|new| new == file))?;
    Ok(MadeViews {
        backend: learner.backend(),
        primitives: learner.size().primitives,
        configuration: outcome.configuration,
        plan: points.into_iter().chain(outcome.plan).collect(),
        evidence,
        planning: outcome.planning,
        iterations: training.state.iteration,
        training_seconds: training.state.training.as_secs_f64(),
        training_cpu_seconds: training.state.training_cpu.map(|time| time.as_secs_f64()),
        evaluation_seconds: training.state.evaluation.as_secs_f64(),
        rendering,
        seconds_per_group: None,
        normalization: scene.normalization,
        trace: Some(TRACE_FILE.to_owned()),
        trace_views: Some(KeptViews {
            folder: TRACE_FOLDER.to_owned(),
            frames: kept.frames,
        }),
        surfaces: training.state.trace.last().and_then(|row| row.surfaces),
        predictions: ViewPredictions {
            input_views: Some(INPUT_FOLDER.to_owned()),
            novel_views: NOVEL_FOLDER.to_owned(),
        },
        warnings,
        outputs,
    })
}

/// What a run may leave, relative to its folder; its checkpoint goes at the end.
fn planned_files(method: &Method, split: &Split) -> Vec<String> {
    let views = |folder: &'static str, frames: &[u32]| {
        let files = frames.iter().map(|&frame| view_file(folder, frame));
        files.collect::<Vec<_>>()
    };
    let mut files = views(NOVEL_FOLDER, &split.novel_views);
    let mut others = vec![RUN_FILE];
    if method.is_trained() {
        files.extend(views(INPUT_FOLDER, &split.input_views));
        others.extend(TRAINING_FILES);
        // Those of an earlier run by another method are replaced or removed.
        others.extend(methods::model_files());
    } else {
        others.push(GROUPS_FILE);
    }
    files.extend(others.into_iter().map(str::to_owned));
    files
}

/// The file of a predicted view, relative to the run's folder.
pub(crate) fn view_file(folder: &str, frame: u32) -> String {
    format!("{folder}/{frame:06}.png")
}

/// The stage with its inputs, and the inputs' hashes by name for the record.
fn plan_stage(
    request: &ReconstructRequest,
    scene: &Scene,
) -> Result<(StagePlan, BTreeMap<String, String>), ReconstructError> {
    let folder = request.scene.parent().unwrap_or(Path::new("."));
    let mut stage = StagePlan::new(&request.out, "reconstruct")
        .with_text("method", &request.method)
        .with_settings("settings", &request.settings)
        .with_settings("trace views", &request.trace_views)
        .with_settings("backend", &request.backend);
    let mut inputs = BTreeMap::new();
    let mut add = |stage: StagePlan, name: &str, path: &Path| -> Result<StagePlan, StoreError> {
        let hash = store::sha256_file(path)?;
        inputs.insert(name.to_owned(), hash.clone());
        Ok(stage.with_hash(name, hash))
    };
    stage = add(stage, "scene.json", &request.scene)?;
    stage = add(stage, "split.json", &request.split)?;
    let tracks = request.split.with_file_name(TRACKS_FILE);
    if tracks.is_file() {
        stage = add(stage, TRACKS_FILE, &tracks)?;
    }
    let split_folder = request.split.parent().unwrap_or(Path::new("."));
    if let Some(points) = ScenePoints::find(scene, folder, split_folder)? {
        stage = add(stage, &points.name, &points.file)?;
    }
    for frame in &scene.frames {
        stage = add(stage, &frame.image, &folder.join(&frame.image))?;
        for mask in (frame.mask.iter())
            .chain(&frame.ignore_mask)
            .chain(frame.objects.values())
        {
            stage = add(stage, mask, &folder.join(mask))?;
        }
        if let Some(prior) = &frame.depth_prior {
            stage = add(stage, &prior.file, &folder.join(&prior.file))?;
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
    let mut warnings = training.warnings.clone();
    warnings.extend(scene.seen_for_points.clone());
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
    if scene.points.is_empty() && outcome.learner.begins_with_points() {
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
