//! One method on one scene: from `scene.json` and `split.json` to Gaussians, predicted views, a
//! trace and `run.json`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Similarity,
    layout::{RUN_FILE, TRACKS_FILE},
    lock::FolderLock,
    progress::Progress,
    provenance,
    records::{Backend, Edits, PoseSource, RunRecord, Scene, Split, ViewPredictions},
    scene_points::ScenePoints,
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    backends,
    jobs::{
        interpolate::{Frames, GROUPS_FILE},
        stage_times,
        trace_folder::{self, TRACE_FOLDER},
        training,
    },
    registry,
    variant::Variant,
};
use omnilife_training::{
    error::ReconstructError,
    formats::OBJECTS_FILE,
    method::{Method, MethodKind, requirement::Requirement},
    models::run_views,
    process,
    request::{BackendChoice, MethodRequest},
    scene,
};

/// Name of the checkpoint in the run's folder; it exists until the run ends.
pub const CHECKPOINT_FILE: &str = "checkpoint.bin";
/// Record of lifted pixels, in the folder of a run that started with them.
pub const LIFT_FILE: &str = "lift.json";
pub(super) const TRACE_FILE: &str = "trace.csv";
/// Page that shows a training, while it learns too.
pub const PAGE_FILE: &str = "progress.html";
/// Files of a training run beside views, the record and the model.
const TRAINING_FILES: [&str; 4] = [TRACE_FILE, PAGE_FILE, LIFT_FILE, CHECKPOINT_FILE];
pub(super) const INPUT_FOLDER: &str = "predictions/input";
pub(crate) const NOVEL_FOLDER: &str = "predictions/novel";

/// Request of a reconstruction.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructRequest {
    /// The scene.
    pub scene: PathBuf,
    /// Its split.
    pub split: PathBuf,
    /// Name of the method.
    pub method: String,
    /// Requested settings.
    pub settings: MethodRequest,
    /// Backend of the computation.
    pub backend: BackendChoice,
    /// Iterations between two checkpoints; 0 writes none.
    pub checkpoint_every: u64,
    /// Maximum number of novel views at each row of the trace; `None` for all.
    pub trace_views: Option<usize>,
    /// Folder that gets an event file for TensorBoard.
    pub tensorboard: Option<PathBuf>,
    /// Folder of the run.
    pub out: PathBuf,
}

/// Checks that the method exists, and that the request suits it.
///
/// # Errors
/// When the method does not exist, or lacks a requested component or backend.
pub fn check(
    method: &str,
    settings: &MethodRequest,
    backend: BackendChoice,
) -> Result<(), ReconstructError> {
    registry::find(method)?.check(settings, backend)
}

/// Runs one method on one scene, or returns the stored record if nothing has changed. An interrupted training run
/// resumes from its checkpoint. Feed-forward methods do not train: they leave no model, trace or input views.
///
/// # Errors
/// When the scene cannot be loaded, the request does not suit the method, training diverges, or the checkpoint is
/// damaged. When a file of another origin is in the way, or a file cannot be written.
pub fn reconstruct(
    request: &ReconstructRequest,
    progress: &dyn Progress,
) -> Result<RunRecord, ReconstructError> {
    let method = registry::find(&request.method)?;
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
    // The lock lasts until the checkpoint is gone: another process may have started one of its own by then.
    let _lock = FolderLock::take(&request.out, progress)?;
    stage.refuse_foreign_folder(TRACE_FOLDER)?;
    let planned = planned_files(method, &split);
    let record = stage.run(planned, progress, |out| -> Result<_, ReconstructError> {
        trace_folder::remove_abandoned(&request.out)?;
        // What an earlier run tells of itself must not stand beside new predictions.
        store::remove(&record_path)?;
        for file in [TRACE_FILE, PAGE_FILE, LIFT_FILE] {
            store::remove(&request.out.join(file))?;
        }
        let mut notes = scene::mask_notes(&request.scene, &request.split)?;
        notes.extend(scene.far_frames());
        notes.extend(scene.planar_ground());
        for line in &notes {
            progress.note(line);
        }
        let mut record = begun_record(method, request, (&scene, &split), inputs);
        let outputs = match method.kind {
            MethodKind::Trained { .. } => {
                training::train(method, request, &split, &stage, progress, &mut record)?
            }
            MethodKind::FeedForward {
                settings,
                interpolate,
            } => {
                record.configuration = settings();
                if request.tensorboard.is_some() {
                    progress.note(&format!(
                        "{}: trains nothing, so that TensorBoard gets no event file",
                        method.id
                    ));
                }
                let frames = Frames::new(request, &scene, &split)?;
                frames.make_views(method.id, interpolate, &stage, progress, &mut record)?
            }
        };
        record.warnings.extend(notes);
        // Methods that can do without tracks have objects where they used them.
        let used_tracks =
            method.needs(Requirement::Tracks) || outputs.iter().any(|file| file == OBJECTS_FILE);
        record.stages = stage_times::of_request(request, &scene, used_tracks)?;
        record.peak_memory_bytes = process::peak_memory_bytes();
        out.add_all(outputs);
        out.write_record(RUN_FILE, &record)?;
        Ok(record)
    })?;
    store::remove(&request.out.join(CHECKPOINT_FILE))?;
    Ok(record)
}

/// Returns the record of a run at its start.
fn begun_record(
    method: &Method,
    request: &ReconstructRequest,
    (scene, split): (&Scene, &Split),
    inputs: BTreeMap<String, String>,
) -> RunRecord {
    let variant = Variant::of(method, &request.settings).to_string();
    let can_be_edited = method.model().is_some_and(|model| model.edit.is_some());
    RunRecord {
        method: method.id.to_owned(),
        variant: (variant != method.id).then_some(variant),
        scene: scene.id.clone(),
        protocol_hash: split.protocol_hash.clone(),
        seed: request.settings.seed,
        backend: Backend::Cpu {
            threads: rayon::current_num_threads() as u32,
        },
        options: request.settings.options.lines().collect(),
        configuration: serde_json::Value::Null,
        plan: Vec::new(),
        aids: None,
        evidence: None,
        planning_seconds: 0.0,
        planning_cpu_seconds: None,
        hardware: Some(provenance::Hardware::here()),
        versions: provenance::versions(),
        inputs,
        iterations: 0,
        primitives: 0,
        training_seconds: 0.0,
        training_cpu_seconds: None,
        evaluation_seconds: 0.0,
        rendering_seconds: 0.0,
        rendering_cpu_seconds: None,
        stages: Vec::new(),
        seconds_per_group: None,
        peak_memory_bytes: None,
        normalization: Similarity::new([0.0; 3], 1.0),
        camera: Some(scene.camera),
        up: run_views::up(scene, split),
        clip_seconds: run_views::clip_seconds(scene, split),
        views: can_be_edited.then(|| run_views::poses(scene, split)),
        trace: None,
        trace_views: None,
        surfaces: None,
        predictions: ViewPredictions {
            input_views: None,
            novel_views: NOVEL_FOLDER.to_owned(),
        },
        warnings: Vec::new(),
        edits: Edits::default(),
    }
}

/// Refuses a scene whose camera only rotates, over no planar ground, to a method that needs places in space.
fn refuse_without_parallax(method: &Method, scene: &Scene) -> Result<(), ReconstructError> {
    if method.needs(Requirement::Parallax)
        && scene.planar_ground().is_none()
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

/// Returns the files that a run may leave, relative to its folder; its checkpoint is removed at the end.
fn planned_files(method: &Method, split: &Split) -> Vec<String> {
    let views = |folder: &'static str, frames: &[u32]| {
        let files = frames.iter().map(|&frame| view_file(folder, frame));
        files.collect::<Vec<_>>()
    };
    let mut files = views(NOVEL_FOLDER, &split.novel_views);
    // Those of a training are claimed by any method, because what an earlier one left is removed.
    let mut others = vec![RUN_FILE];
    others.extend(TRAINING_FILES);
    if method.is_trained() {
        files.extend(views(INPUT_FOLDER, &split.input_views));
        // Files of an earlier run by another method are replaced or removed.
        others.extend(registry::model_files());
    } else {
        others.push(GROUPS_FILE);
    }
    files.extend(others.into_iter().map(str::to_owned));
    files
}

/// Returns the file of a novel view, relative to the run's folder.
pub(crate) fn view_file(folder: &str, frame: u32) -> String {
    format!("{folder}/{frame:06}.png")
}

/// Returns the stage with its inputs, and the inputs' hashes by name for the record.
fn plan_stage(
    request: &ReconstructRequest,
    scene: &Scene,
) -> Result<(StagePlan, BTreeMap<String, String>), ReconstructError> {
    let folder = request.scene.parent().unwrap_or(Path::new("."));
    let mut stage = StagePlan::new(&request.out, RunRecord::STAGE)
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

/// Makes a folder of views, and removes the views of an earlier run alone: another split would score them by
/// mistake.
pub(crate) fn prepare_predictions(
    stage: &StagePlan,
    out: &Path,
    folder: &str,
) -> Result<(), StoreError> {
    let is_view = |file: &str| file.rsplit_once('/').is_some_and(|(of, _)| of == folder);
    stage.own_files().remove(is_view)?;
    store::create_folder(&out.join(folder))
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        camera::{Camera, ErpCamera, PinholeCamera},
        records::Scale,
    };

    use super::*;

    #[test]
    fn a_registered_scene_needs_planar_ground() {
        let method = registry::find("object-graph").expect("a method");
        let pinhole = PinholeCamera::with_horizontal_field_of_view(64, 36, 1.0);
        let hovering = Scene {
            points: Some("points.ply".to_owned()),
            pose_source: PoseSource::Registered {
                reason: "rotations leave 1.40 pixels between frames".to_owned(),
                succeeded: true,
            },
            ..Scene::given("hover", pinhole, Vec::new())
        };
        assert!(refuse_without_parallax(method, &hovering).is_ok());
        let line = hovering.planar_ground().expect("a line");
        assert!(line.contains("relative to its height"), "{line}");
        let metric = Scene {
            scale: Scale::Metres,
            ..hovering.clone()
        };
        assert!(
            metric
                .planar_ground()
                .is_some_and(|line| line.contains("metres"))
        );
        let uncertain = PoseSource::Registered {
            reason: "rotations leave 1.40 pixels between frames".to_owned(),
            succeeded: false,
        };
        for refused in [
            Scene {
                points: None,
                ..hovering.clone()
            },
            Scene {
                pose_source: uncertain,
                ..hovering.clone()
            },
            Scene {
                camera: Camera::from(ErpCamera::new(64, 32)),
                ..hovering.clone()
            },
        ] {
            let error = refuse_without_parallax(method, &refused).expect_err("refused");
            let message = error.to_string();
            assert!(
                message.contains("1.40 pixels") && !message.contains('\n'),
                "{message}"
            );
        }
        // A flight is a flight.
        let flight = Scene::given("flight", pinhole, Vec::new());
        assert!(refuse_without_parallax(method, &flight).is_ok());
        assert_eq!(flight.planar_ground(), None);
    }
}
