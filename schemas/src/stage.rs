//! Stages: idempotent pieces of work that are skipped while their inputs have not changed.
//!
//! A finished stage leaves a done-record beside its outputs with the hash of everything that went
//! in. [`StagePlan::is_done`] compares hashes and checks that the outputs still stand.

use std::{
    fs,
    path::{Path, PathBuf},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::{self, Record, StoreError};

/// The done-record of a stage, `.done/<stage>.json` in the stage's folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Done {
    /// Name of the stage.
    pub stage: String,
    /// SHA-256 over the hashes of all inputs in their order, settings included. The names of
    /// inputs are left out, so that a folder may be moved and its stages stay done: what a stage
    /// hashes is content, never a path.
    pub inputs_sha256: String,
    /// Every input with its hash, for people.
    pub inputs: Vec<StageInput>,
    /// Outputs relative to the stage's folder, with their sizes.
    pub outputs: Vec<StageOutput>,
    /// Wall-clock time the stage took, seconds.
    pub wall_seconds: f64,
}

impl Record for Done {
    const SCHEMA: &'static str = "omnilife/done/1";
}

/// One thing a stage depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StageInput {
    /// What it is.
    pub name: String,
    /// SHA-256 of its content.
    pub sha256: String,
}

/// One file a stage made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StageOutput {
    /// Relative to the stage's folder.
    pub file: String,
    /// Size in bytes.
    pub bytes: u64,
}

/// A stage about to run (or to be skipped): its folder, name and inputs.
#[derive(Debug, Clone)]
pub struct StagePlan {
    folder: PathBuf,
    stage: String,
    inputs: Vec<StageInput>,
}

impl StagePlan {
    /// A stage named `stage` that writes into `folder`.
    ///
    /// The program's version is always an input: another version may compute something else.
    pub fn new(folder: &Path, stage: &str) -> Self {
        let plan = Self {
            folder: folder.to_owned(),
            stage: stage.to_owned(),
            inputs: Vec::new(),
        };
        plan.with_text("omnilife version", env!("CARGO_PKG_VERSION"))
    }

    /// Adds a text as an input.
    pub fn with_text(mut self, name: &str, text: &str) -> Self {
        self.inputs.push(StageInput {
            name: name.to_owned(),
            sha256: store::sha256_bytes(text.as_bytes()),
        });
        self
    }

    /// Adds settings, as their JSON, as an input.
    pub fn with_settings(self, name: &str, settings: &impl Serialize) -> Self {
        // Settings are plain structs of numbers and strings; a failure to serialize them becomes
        // part of the hash instead of being lost.
        let text = serde_json::to_string(settings).unwrap_or_else(|error| error.to_string());
        self.with_text(name, &text)
    }

    /// Adds a file's content as an input.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn with_file(self, path: &Path) -> Result<Self, StoreError> {
        let sha256 = store::sha256_file(path)?;
        Ok(self.with_hash(&path.display().to_string(), sha256))
    }

    /// Adds an input whose hash is known already.
    pub fn with_hash(mut self, name: &str, sha256: String) -> Self {
        self.inputs.push(StageInput {
            name: name.to_owned(),
            sha256,
        });
        self
    }

    /// SHA-256 over all inputs, in the order in which they were added.
    pub fn inputs_sha256(&self) -> String {
        let text: String = self
            .inputs
            .iter()
            .map(|input| format!("{}\n", input.sha256))
            .collect();
        store::sha256_bytes(text.as_bytes())
    }

    /// Whether a done-record with the same inputs exists and all its outputs stand with the
    /// recorded sizes. An unreadable done-record means that the stage is not done.
    pub fn is_done(&self) -> bool {
        let Ok(done) = store::read_record::<Done>(&self.record_path()) else {
            return false;
        };
        done.inputs_sha256 == self.inputs_sha256()
            && done.outputs.iter().all(|output| {
                fs::metadata(self.folder.join(&output.file))
                    .is_ok_and(|metadata| metadata.len() == output.bytes)
            })
    }

    /// Removes the done-record, because from here on the outputs may be half new, and what a
    /// killed process left half-written.
    ///
    /// # Errors
    /// When something that is there cannot be removed.
    pub fn begin(&self) -> Result<(), StoreError> {
        store::remove(&self.record_path())?;
        store::remove_abandoned(&self.folder)
    }

    /// Writes the done-record for outputs given relative to the stage's folder.
    ///
    /// # Errors
    /// When an output is missing or the record cannot be written.
    pub fn finish<S: AsRef<str>>(
        &self,
        outputs: impl IntoIterator<Item = S>,
        wall_seconds: f64,
    ) -> Result<(), StoreError> {
        let mut recorded = Vec::new();
        for output in outputs {
            let path = self.folder.join(output.as_ref());
            let metadata =
                fs::metadata(&path).map_err(|source| StoreError::write(&path, source))?;
            recorded.push(StageOutput {
                file: output.as_ref().to_owned(),
                bytes: metadata.len(),
            });
        }
        let path = self.record_path();
        if let Some(parent) = path.parent() {
            store::create_folder(parent)?;
        }
        store::write_record(
            &path,
            &Done {
                stage: self.stage.clone(),
                inputs_sha256: self.inputs_sha256(),
                inputs: self.inputs.clone(),
                outputs: recorded,
                wall_seconds,
            },
        )
    }

    fn record_path(&self) -> PathBuf {
        self.folder
            .join(".done")
            .join(format!("{}.json", self.stage))
    }
}
