//! One method on one scene: from `scene.json` and `split.json` to Gaussians, predicted views, a
//! trace and `run.json`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    Pose,
    progress::Progress,
    provenance,
    records::{PosedFrame, Poses, RunRecord, Scale, Scene, Split, ViewPredictions},
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    error::ReconstructError,
    formats::{deformation, moving_ply, ply},
    methods::{self, MethodOutcome, feed_forward},
    process,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    train::{Session, TrainingFiles, trace},
};
use omnilife_engine::{model::Model, training_view::TrainingView};

/// Name of the record in the run's folder.
pub const RUN_FILE: &str = "run.json";
/// Name of the Gaussians in the run's folder.
pub const GAUSSIANS_FILE: &str = "gaussians.ply";
/// Name of the Gaussians that depend on time in the run's folder; static methods have none.
pub const MOVING_GAUSSIANS_FILE: &str = "gaussians-moving.ply";
/// Name of the network that deforms Gaussians in the run's folder; most methods have none.
pub const DEFORMATION_FILE: &str = "deformation.safetensors";
/// Name of the refined poses in the run's folder, where they were refined: those of the input views,
/// and what is taken for those of the novel views.
pub const REFINED_POSES_FILE: &str = "refined-poses.json";
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
/// the checkpoint is damaged or a file cannot be written.
pub fn reconstruct(
    request: &ReconstructRequest,
    progress: &dyn Progress,
) -> Result<RunRecord, ReconstructError> {
    if let Some(interpolator) = feed_forward::find(&request.method) {
        return crate::jobs::interpolate::interpolate(interpolator, request, progress);
    }
    let method = methods::find(&request.method)?;
    method.check(&request.settings)?;
    store::create_folder(&request.out)?;
    store::remove_abandoned(&request.out)?;
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
    stage.begin()?;
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
    };
    let mut outcome = method.train(&scene, &request.settings, &session)?;
    let rendering = Instant::now();
    let mut outputs = render_predictions(&scene, &mut outcome, &request.out, progress)?;
    let rendering_seconds = rendering.elapsed().as_secs_f64();
    let trained = &mut outcome.trained;
    let gaussians = trained.stepper.gaussians() as u64;
    let model = trained.stepper.model()?;
    ply::write(
        &request.out.join(GAUSSIANS_FILE),
        &model.table,
        &scene.normalization,
    )?;
    let moving_path = request.out.join(MOVING_GAUSSIANS_FILE);
    store::remove(&moving_path)?;
    if let (Some(moving), Some(dynamics)) = (&model.moving, &outcome.settings.dynamics) {
        let (time, clock) = (&dynamics.time, &dynamics.clock);
        moving_ply::write(
            &moving_path,
            &moving.table,
            time,
            &scene.normalization,
            clock,
        )?;
        outputs.push(MOVING_GAUSSIANS_FILE.to_owned());
    }
    let deformation_path = request.out.join(DEFORMATION_FILE);
    store::remove(&deformation_path)?;
    if let (Some(weights), Some(settings)) = (&model.deformation, &outcome.settings.deformation) {
        deformation::write(&deformation_path, &settings.model, weights)?;
        outputs.push(DEFORMATION_FILE.to_owned());
    }
    let poses_path = request.out.join(REFINED_POSES_FILE);
    store::remove(&poses_path)?;
    if model.poses.is_some() {
        let of_scene: Scene = store::read_record(&request.scene)?;
        let poses = refined_poses(&scene, model, of_scene.scale);
        store::write_record(&poses_path, &poses)?;
        outputs.push(REFINED_POSES_FILE.to_owned());
    }
    trace::write_csv(&trace_path, &trained.state.trace)?;
    let split: Split = store::read_record(&request.split)?;
    let record = RunRecord {
        method: method.id.to_owned(),
        scene: scene.id.clone(),
        protocol_hash: split.protocol_hash.clone(),
        seed: request.settings.seed,
        backend: trained.stepper.backend(),
        configuration: serde_json::to_value(&outcome.settings)
            .map_err(|error| StoreError::write(&record_path, std::io::Error::other(error)))?,
        plan: outcome.plan.clone(),
        hardware: Some(provenance::Hardware::here()),
        versions: provenance::versions(),
        inputs,
        iterations: trained.state.iteration,
        gaussians,
        training_seconds: trained.state.training.as_secs_f64(),
        training_cpu_seconds: trained.state.training_cpu.map(|time| time.as_secs_f64()),
        evaluation_seconds: trained.state.evaluation.as_secs_f64(),
        rendering_seconds,
        seconds_per_group: None,
        peak_memory_bytes: process::peak_memory_bytes(),
        normalization: scene.normalization,
        trace: Some(TRACE_FILE.to_owned()),
        predictions: ViewPredictions {
            input_views: Some(INPUT_FOLDER.to_owned()),
            novel_views: NOVEL_FOLDER.to_owned(),
        },
        warnings: warnings(&scene, &split, &outcome, gaussians),
    };
    store::write_record(&record_path, &record)?;
    outputs.extend([RUN_FILE, TRACE_FILE, GAUSSIANS_FILE].map(str::to_owned));
    stage.finish(outputs, begun.elapsed().as_secs_f64())?;
    store::remove(&checkpoint)?;
    Ok(record)
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
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let (trained, settings) = (&mut outcome.trained, &outcome.settings);
    let total = scene.input_views.len() + scene.novel_views.len();
    progress.begin("rendering", Some(total as u64));
    let mut files = Vec::with_capacity(total);
    let mut render = |views: &[TrainingView], name: &str| -> Result<(), ReconstructError> {
        let folder = out.join(name);
        prepare_predictions(&folder)?;
        for view in views {
            let file = format!("{name}/{:06}.png", view.frame);
            let mut image = trained.stepper.image(&view.view, trained.sh_degree)?;
            settings.expose(&mut image, view.view.time_seconds);
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

/// The poses of all views of the split as the model has them, in world units and in order of time.
fn refined_poses(scene: &TrainingScene, model: &Model, scale: Scale) -> Poses {
    let views = scene.input_views.iter().chain(&scene.novel_views);
    let mut frames: Vec<PosedFrame> = views
        .filter_map(|view| {
            let view = model.corrected(&view.view);
            let centre = scene.normalization.restore(view.centre.as_dvec3());
            let pose = Pose::from_matrix(view.rotation.transpose().as_dmat3(), centre)?;
            Some(PosedFrame {
                time_seconds: view.time_seconds,
                pose,
                mask: None,
            })
        })
        .collect();
    frames.sort_by(|one, other| one.time_seconds.total_cmp(&other.time_seconds));
    Poses {
        scale,
        frames,
        points: None,
    }
}

/// Makes the folder, and removes the views of an earlier run, which another split would score by
/// mistake, and nothing else.
pub(crate) fn prepare_predictions(folder: &Path) -> Result<(), StoreError> {
    store::create_folder(folder)?;
    let is_prediction = |name: &str| {
        name.strip_suffix(".png")
            .is_some_and(|stem| stem.len() == 6 && stem.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let entries = fs::read_dir(folder).map_err(|source| StoreError::read(folder, source))?;
    for entry in entries {
        let entry = entry.map_err(|source| StoreError::read(folder, source))?;
        if is_prediction(&entry.file_name().to_string_lossy()) {
            store::remove(&entry.path())?;
        }
    }
    Ok(())
}

fn warnings(
    scene: &TrainingScene,
    split: &Split,
    outcome: &MethodOutcome<'_>,
    gaussians: u64,
) -> Vec<String> {
    let trained = &outcome.trained;
    let mut warnings = trained.remarks.clone();
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
    if masked > 0 && masked < scene.input_views.len() && outcome.settings.dynamics.is_some() {
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
    if gaussians == 0 {
        warnings.push("no Gaussian is left; the views show the background".to_owned());
    }
    if scene.is_normalized_by_points {
        warnings.push(
            "the cameras hardly move in a scene of this size; it is normalized by its points"
                .to_owned(),
        );
    }
    let refused: u64 = trained.state.refused.iter().sum();
    if refused > 0 {
        warnings.push(format!(
            "{refused} gradient values were not finite and were not applied; the trace counts them \
             by array"
        ));
    }
    if trained.stopped_by_budget {
        warnings.push(format!(
            "the time budget ended training after {} of {} iterations",
            trained.state.iteration, outcome.settings.iterations
        ));
    }
    warnings
}
