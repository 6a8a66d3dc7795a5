//! Facts from a run's record that belong beside its scores, for any run.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{RUN_FILE, SCENE_FILE, SCENE_MASKS_FOLDER, SPLIT_FILE, TRACKS_FILE},
    ownership::{NameState, OwnFile},
    plain_text,
    provenance::Hardware,
    records::{
        Backend, ExternalRun, PhaseName, RunRecord, Scene, SceneFrame, StageTime, TrainingKind,
    },
    stage::StagePlan,
    store::{self, Record, StoreError},
};

use crate::{curve::rows::Trace, error::BenchError, external::EXTERNAL_RUN_FILE};

/// Folders of views lie at most so far below the record of their run: `predictions/novel`, `work/a/b`.
const DEPTH_OF_VIEWS: usize = 4;

/// Refuses a folder of views in a run that is never scored: a failed one, or one with an edited model.
///
/// # Errors
/// For such a run; its record is named.
pub(crate) fn refuse_views_of_other_runs(folder: &Path) -> Result<(), BenchError> {
    let Ok(folder) = folder.canonicalize() else {
        return Ok(());
    };
    for folder in folder.ancestors().take(DEPTH_OF_VIEWS) {
        let [ours, external] = [RUN_FILE, EXTERNAL_RUN_FILE].map(|name| folder.join(name));
        if is_record_of::<RunRecord>(&ours) {
            return refuse_edited(&ours, &store::read_record(&ours)?);
        }
        if is_record_of::<ExternalRun>(&external) {
            let run: ExternalRun = store::read_record(&external)?;
            return match run.failure {
                Some(failure) => {
                    let reason = format!("failed ({failure}): views that it left are not scored");
                    Err(BenchError::mismatch(&external, reason))
                }
                None => Ok(()),
            };
        }
    }
    Ok(())
}

/// Returns true for a record of this kind; other programs have files of these names too.
fn is_record_of<T: Record>(file: &Path) -> bool {
    file.is_file() && store::schema_of(file).is_ok_and(|schema| store::is_read_as::<T>(&schema))
}

fn refuse_edited(file: &Path, run: &RunRecord) -> Result<(), BenchError> {
    match run.edits.lines().first() {
        Some(edit) => {
            let reason = format!("was edited ({edit}): it is not scored against the video");
            Err(BenchError::mismatch(file, reason))
        }
        None => Ok(()),
    }
}

/// The record of a run of ours (`run.json`) or of an external method (`external-run.json`).
pub(crate) struct RunFacts {
    /// The method's name in tables.
    pub(crate) method: String,
    pub(crate) scene: String,
    pub(crate) protocol_hash: String,
    pub(crate) training_seconds: Option<f64>,
    /// Kind of training of the method, if recorded.
    pub(crate) training: Option<TrainingKind>,
    /// Aids that the method can have, with true where the run used it, if recorded.
    pub(crate) aids: Option<BTreeMap<String, bool>>,
    pub(crate) primitives: Option<u64>,
    pub(crate) iterations: Option<u64>,
    pub(crate) seed: u64,
    pub(crate) backend: Option<Backend>,
    pub(crate) hardware: Option<Hardware>,
    pub(crate) versions: BTreeMap<String, String>,
    pub(crate) rendering_seconds: Option<f64>,
    /// Times of the stages from the video on, if recorded.
    pub(crate) stages: Vec<StageTime>,
    pub(crate) peak_memory_bytes: Option<u64>,
    pub(crate) warnings: Vec<String>,
    /// Reason for missing views.
    pub(crate) failure: Option<String>,
    pub(crate) input_folder: Option<PathBuf>,
    pub(crate) novel_folder: PathBuf,
    /// Its trace with the novel views along it, if it left them.
    pub(crate) trace: Option<Trace>,
    /// Options that it was given.
    pub(crate) options: Vec<String>,
    /// Hash of its split, if recorded.
    pub(crate) split_sha256: Option<String>,
    /// Name of the stage that wrote it.
    stage: &'static str,
    /// Hashes of what it was trained on by their names, if recorded: files of the scene among them.
    inputs: BTreeMap<String, String>,
}

impl RunFacts {
    /// Reads either record.
    ///
    /// # Errors
    /// When the file is neither of them.
    pub(crate) fn read(file: &Path) -> Result<Self, BenchError> {
        let schema = store::schema_of(file)?;
        if store::is_read_as::<RunRecord>(&schema) {
            let run: RunRecord = store::read_record(file)?;
            refuse_edited(file, &run)?;
            let trace = Trace::of_run(file, &run)?;
            Ok(Self::of_ours(file, run, trace))
        } else if store::is_read_as::<ExternalRun>(&schema) {
            Ok(Self::of_external(file, store::read_record(file)?))
        } else {
            let (ours, external) = (RunRecord::SCHEMA, ExternalRun::SCHEMA);
            Err(StoreError::malformed(
                file,
                format!("is of schema {schema}, expected {ours} or {external}"),
            )
            .into())
        }
    }

    /// Adds a warning if views of the run with the record `file` are not as it wrote them.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn note_changed_views(&mut self, file: &Path) -> Result<(), BenchError> {
        // A failed run leaves views of which nothing is known, and none of them is scored.
        let Some(folder) = file.parent().filter(|_| self.failure.is_none()) else {
            return Ok(());
        };
        let written = StagePlan::new(folder, self.stage).own_files();
        let views = [Some(&self.novel_folder), self.input_folder.as_ref()];
        let mut changed = Vec::new();
        for OwnFile { file, .. } in written.files() {
            let path = folder.join(&file);
            let is_view = views.iter().flatten().any(|views| path.starts_with(views));
            if is_view && written.standing(&file)? == NameState::Changed {
                changed.push(file);
            }
        }
        self.warn_of(
            &changed,
            "views changed after the run wrote them",
            "scores are of the changed ones",
        );
        Ok(())
    }

    /// Adds a warning if files of the scene are others than those that the run was trained on.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn note_other_inputs(&mut self, scene: &Path) -> Result<(), BenchError> {
        let mut others = Vec::new();
        // These lie beside the split, where the scene may have others of their names.
        let of_scene = (self.inputs.iter())
            .filter(|(name, _)| ![SPLIT_FILE, TRACKS_FILE].contains(&name.as_str()));
        for (name, trained) in of_scene {
            let file = scene.with_file_name(name);
            if file.is_file() && store::sha256_file(&file)? != *trained {
                others.push(name.clone());
            }
        }
        self.warn_of(
            &others,
            "files of the scene changed after the training",
            "the run did not see what it is scored against",
        );
        Ok(())
    }

    /// Returns the hashes of what the run began with beside images, by name: runs that differ in one of these do not
    /// compare methods. All masks of moving content have one hash together.
    pub(crate) fn inputs_beside_images(&self, scene: &Scene) -> BTreeMap<String, String> {
        let of_frames: BTreeSet<&String> =
            scene.frames.iter().flat_map(SceneFrame::files).collect();
        let mut beside = self.inputs.clone();
        beside.retain(|name, _| {
            ![SCENE_FILE, SPLIT_FILE].contains(&name.as_str()) && !of_frames.contains(name)
        });
        let masks = scene.frames.iter().filter_map(|frame| frame.mask.as_ref());
        let masks: Vec<&str> = masks
            .filter_map(|mask| Some(self.inputs.get(mask)?.as_str()))
            .collect();
        if !masks.is_empty() {
            let all = store::sha256_bytes(masks.join("\n").as_bytes());
            beside.insert(SCENE_MASKS_FOLDER.to_owned(), all);
        }
        beside
    }

    /// Adds a warning with the number and the first names of files, if there are any.
    fn warn_of(&mut self, files: &[String], change: &str, consequence: &str) {
        if !files.is_empty() {
            self.warnings.push(format!(
                "{change}: {} ({}); {consequence}",
                files.len(),
                plain_text::first_of(files)
            ));
        }
    }

    fn of_ours(file: &Path, run: RunRecord, trace: Option<Trace>) -> Self {
        Self {
            trace,
            stage: RunRecord::STAGE,
            stages: run.stage_times(),
            input_folder: run
                .predictions
                .input_views
                .as_ref()
                .map(|folder| file.with_file_name(folder)),
            novel_folder: file.with_file_name(&run.predictions.novel_views),
            split_sha256: run.inputs.get(SPLIT_FILE).cloned(),
            options: run.options,
            inputs: run.inputs,
            method: run.variant.unwrap_or(run.method),
            scene: run.scene,
            protocol_hash: run.protocol_hash,
            training_seconds: Some(run.training_seconds),
            training: Some(if run.iterations > 0 {
                TrainingKind::PerScene
            } else {
                TrainingKind::WithoutTraining
            }),
            aids: run.aids,
            primitives: Some(run.primitives),
            iterations: Some(run.iterations),
            seed: run.seed,
            backend: Some(run.backend),
            hardware: run.hardware,
            versions: run.versions,
            rendering_seconds: Some(run.rendering_seconds),
            peak_memory_bytes: run.peak_memory_bytes,
            warnings: run.warnings,
            failure: None,
        }
    }

    fn of_external(file: &Path, run: ExternalRun) -> Self {
        let wall_seconds = |name| {
            let mut phases = run.phases.iter();
            phases
                .find(|phase| phase.name == name)
                .map(|phase| phase.wall_seconds)
        };
        Self {
            input_folder: run.input_views.map(|folder| file.with_file_name(folder)),
            novel_folder: file.with_file_name(&run.novel_views),
            trace: None,
            stage: ExternalRun::STAGE,
            split_sha256: run.inputs.get(SPLIT_FILE).cloned(),
            options: Vec::new(),
            method: run.method,
            scene: run.scene,
            protocol_hash: run.protocol_hash,
            // The duration of a failed run has no meaning.
            training_seconds: wall_seconds(PhaseName::Train).filter(|_| run.failure.is_none()),
            // A failed run may not have reached its training.
            training: match wall_seconds(PhaseName::Train) {
                Some(_) => Some(TrainingKind::PerScene),
                None if run.failure.is_some() => None,
                None => Some(TrainingKind::WithoutTraining),
            },
            aids: None,
            primitives: None,
            iterations: None,
            seed: run.seed,
            // The processor of an external method is unknown.
            backend: None,
            hardware: run.hardware,
            versions: run.versions,
            rendering_seconds: wall_seconds(PhaseName::Render),
            stages: Vec::new(),
            peak_memory_bytes: run.phases.iter().filter_map(|p| p.peak_memory_bytes).max(),
            warnings: run.warnings,
            inputs: run.inputs,
            failure: run.failure,
        }
    }
}
