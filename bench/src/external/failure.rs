//! The record of a run that failed before it could leave one.

use std::path::PathBuf;

use omnilife_schemas::{
    provenance,
    records::{ExternalRun, Scene, Split},
    stage::StagePlan,
    store,
};

use super::{EXTERNAL_RUN_FILE, INPUT_FOLDER, NOVEL_FOLDER, STAGE};
use crate::{error::BenchError, split};

/// Which run failed, why, and where the record goes.
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
    /// Why it failed, in one line.
    pub reason: String,
    /// Folder of the record; made where it is missing.
    pub out: PathBuf,
}

/// Writes an `external-run.json` without predictions: scored, every view of it is a failure, so that
/// the run is a row of the tables.
///
/// # Errors
/// When scene and split are unusable or do not belong together, a file that is no record of ours is in
/// the way, or a file cannot be written.
pub fn record_failure(request: &FailureRequest) -> Result<PathBuf, BenchError> {
    let scene: Scene = store::read_record(&request.scene)?;
    let split: Split = store::read_record(&request.split)?;
    split::check_split(&request.split, &split, &scene)?;
    let file = request.out.join(EXTERNAL_RUN_FILE);
    // The record of a run may be replaced by that of its failure, nothing else may.
    store::create_folder(&request.out)?;
    StagePlan::new(&request.out, STAGE).claim([EXTERNAL_RUN_FILE])?;
    for folder in [NOVEL_FOLDER, INPUT_FOLDER] {
        store::create_folder(&request.out.join(folder))?;
    }
    let record = ExternalRun {
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
    };
    store::write_record(&file, &record)?;
    Ok(file)
}
