//! What a run's record says that belongs beside its scores, whoever's run it was.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    provenance::Hardware,
    records::{Backend, ExternalRun, PhaseName, RunRecord, StageTime},
    store::{self, Record, StoreError},
};

use crate::{curve::rows::Trace, error::BenchError};

/// The record of a run of ours (`run.json`) or of an external method (`external-run.json`).
pub(crate) struct RunFacts {
    /// The method's name in tables.
    pub(crate) method: String,
    pub(crate) scene: String,
    pub(crate) protocol_hash: String,
    pub(crate) training_seconds: Option<f64>,
    pub(crate) primitives: Option<u64>,
    pub(crate) iterations: Option<u64>,
    pub(crate) seed: u64,
    pub(crate) backend: Option<Backend>,
    pub(crate) hardware: Option<Hardware>,
    pub(crate) versions: BTreeMap<String, String>,
    pub(crate) rendering_seconds: Option<f64>,
    /// What the way from the video took, stage by stage, where the record says.
    pub(crate) stages: Vec<StageTime>,
    pub(crate) peak_memory_bytes: Option<u64>,
    pub(crate) warnings: Vec<String>,
    /// Why views may be missing.
    pub(crate) failure: Option<String>,
    pub(crate) input_folder: Option<PathBuf>,
    pub(crate) novel_folder: PathBuf,
    /// Its trace with the novel views along it, where it left them.
    pub(crate) trace: Option<Trace>,
    /// Hash of the split that it was made by, where the record says.
    pub(crate) split_sha256: Option<String>,
}

impl RunFacts {
    /// Reads either record.
    ///
    /// # Errors
    /// When the file is neither.
    pub(crate) fn read(file: &Path) -> Result<Self, BenchError> {
        let schema = store::schema_of(file)?;
        if store::is_read_as::<RunRecord>(&schema) {
            let run: RunRecord = store::read_record(file)?;
            if let Some(edit) = run.edits.lines().first() {
                let reason = format!("was edited ({edit}): it is not scored against the video");
                return Err(BenchError::mismatch(file, reason));
            }
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

    fn of_ours(file: &Path, run: RunRecord, trace: Option<Trace>) -> Self {
        Self {
            trace,
            input_folder: run
                .predictions
                .input_views
                .as_ref()
                .map(|folder| file.with_file_name(folder)),
            novel_folder: file.with_file_name(&run.predictions.novel_views),
            split_sha256: run.inputs.get("split.json").cloned(),
            method: run.variant.unwrap_or(run.method),
            scene: run.scene,
            protocol_hash: run.protocol_hash,
            training_seconds: Some(run.training_seconds),
            primitives: Some(run.primitives),
            iterations: Some(run.iterations),
            seed: run.seed,
            backend: Some(run.backend),
            hardware: run.hardware,
            versions: run.versions,
            rendering_seconds: Some(run.rendering_seconds),
            stages: run.stages,
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
            split_sha256: None,
            method: run.method,
            scene: run.scene,
            protocol_hash: run.protocol_hash,
            training_seconds: wall_seconds(PhaseName::Train),
            primitives: None,
            iterations: None,
            seed: run.seed,
            // Whether a method of others computes on a processor is its own affair.
            backend: None,
            hardware: run.hardware,
            versions: run.versions,
            rendering_seconds: wall_seconds(PhaseName::Render),
            stages: Vec::new(),
            peak_memory_bytes: run.phases.iter().filter_map(|p| p.peak_memory_bytes).max(),
            warnings: run.warnings,
            failure: run.failure,
        }
    }
}
