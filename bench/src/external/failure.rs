//! Record of a run that failed without leaving one.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    progress::Progress,
    provenance,
    records::{ExternalRun, Scene, Split},
    stage::StagePlan,
    store,
};

use super::{EXTERNAL_RUN_FILE, INPUT_FOLDER, NOVEL_FOLDER};
use crate::{error::BenchError, split};

/// A failed run, its reason, and the place of the record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FailureRequest {
    /// Id of the method.
    pub method: String,
    /// The `scene.json`.
    pub scene: PathBuf,
    /// The `split.json` of that scene.
    pub split: PathBuf,
    /// Random seed of the run.
    pub seed: u64,
    /// Reason of the failure, in one line.
    pub reason: String,
    /// Folder of the run. If an `external-run.json` there records a failure of this run, its reason, environment and
    /// commands are taken over.
    pub run: Option<PathBuf>,
    /// Folder of the record; created if missing.
    pub out: PathBuf,
}

/// Writes an `external-run.json` without predictions. When scored, every view of it is a failure, so that the run is a
/// row of the tables.
///
/// # Errors
/// When scene and split are unusable or do not belong together, a file that is not a record of this program is in
/// the way, or a file cannot be written.
pub fn record_failure(
    request: &FailureRequest,
    progress: &dyn Progress,
) -> Result<PathBuf, BenchError> {
    let scene: Scene = store::read_record(&request.scene)?;
    let split: Split = store::read_record(&request.split)?;
    split::check_split(&request.split, &split, &scene)?;
    let fallback = ExternalRun {
        method: request.method.clone(),
        source: None,
        licence: None,
        manifest_sha256: String::new(),
        scene: scene.id,
        protocol_hash: split.protocol_hash,
        seed: request.seed,
        environment: "none".to_owned(),
        hardware: Some(provenance::Hardware::here()),
        versions: provenance::versions(),
        phases: Vec::new(),
        failure: Some(request.reason.clone()),
        novel_views: NOVEL_FOLDER.to_owned(),
        input_views: Some(INPUT_FOLDER.to_owned()),
        warnings: Vec::new(),
        inputs: BTreeMap::new(),
    };
    let record = match &request.run {
        Some(run) => failed_run(run, &fallback).unwrap_or(fallback),
        None => fallback,
    };
    // The record of a run may be replaced by that of its failure, nothing else may.
    StagePlan::new(&request.out, ExternalRun::STAGE).run([EXTERNAL_RUN_FILE], progress, |out| {
        for folder in [NOVEL_FOLDER, INPUT_FOLDER] {
            store::create_folder(&out.path(folder))?;
        }
        out.write_record(EXTERNAL_RUN_FILE, &record)?;
        out.leave_begun();
        Ok(out.path(EXTERNAL_RUN_FILE))
    })
}

/// Returns the failed run's own record, without its predictions; `None` without one, or for one of another or a
/// successful run.
fn failed_run(run: &Path, expected: &ExternalRun) -> Option<ExternalRun> {
    let file = run.join(EXTERNAL_RUN_FILE);
    let record: ExternalRun = file.is_file().then(|| store::read_record(&file).ok())??;
    let is_of_run = record.method == expected.method
        && record.scene == expected.scene
        && record.protocol_hash == expected.protocol_hash
        && record.seed == expected.seed;
    (is_of_run && record.failure.is_some()).then(|| ExternalRun {
        novel_views: expected.novel_views.clone(),
        input_views: expected.input_views.clone(),
        ..record
    })
}
