//! Stages: idempotent pieces of work that are skipped while their inputs have not changed.
//!
//! A finished stage leaves a done-record beside its outputs with the hashes of all inputs and outputs.
//! [`StagePlan::is_done`] compares hashes and checks that the outputs still exist.
//!
//! The record also names the stage's own files. Before a stage writes anything it claims its outputs, and refuses to
//! replace a file that it has not made. The claim is kept on disk until the stage is finished, so that the successor
//! of a killed process owns its files. [`StagePlan::make`] and [`StagePlan::run`] do all that in the one safe order.

mod outputs;

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    elapsed::Elapsed,
    lock::{FolderLock, LOCK_FILE},
    ownership::{NameState, OwnFile, OwnFiles, path_inside},
    progress::{Progress, Silent},
    store::{self, Record, StoreError},
};

pub use outputs::StageOutputs;

/// Folder of the done-records in a stage's folder.
const RECORDS_FOLDER: &str = ".done";

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
    /// Outputs relative to the stage's folder, with their sizes and hashes.
    pub outputs: Vec<StageOutput>,
    /// Time the stage took.
    #[serde(flatten)]
    pub took: Elapsed,
}

impl Record for Done {
    const SCHEMA: &'static str = "omnilife/done/1";
}

/// One thing a stage depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StageInput {
    /// Name of the input.
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
    /// SHA-256 of the content; `None` where only the size was looked at.
    #[serde(default)]
    pub sha256: Option<String>,
}

/// A stage that has started and not finished, `.done/<stage>.begun.json` in the stage's folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StageStart {
    /// Name of the stage.
    pub stage: String,
    /// The stage's own files: what it made earlier, and what it is about to make.
    pub files: Vec<OwnFile>,
}

impl Record for StageStart {
    const SCHEMA: &'static str = "omnilife/begun/1";
}

/// Stage that may have to run: its folder, name and inputs.
#[derive(Debug, Clone)]
pub struct StagePlan {
    folder: PathBuf,
    stage: String,
    inputs: Vec<StageInput>,
}

impl StagePlan {
    /// Makes a stage named `stage` that writes into `folder`.
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
        // Settings are plain structs of numbers and strings. A failure to serialize them becomes part of the hash
        // instead of being lost.
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

    /// Returns the SHA-256 over all inputs, in the order in which they were added.
    pub fn inputs_sha256(&self) -> String {
        let text: String = self
            .inputs
            .iter()
            .map(|input| format!("{}\n", input.sha256))
            .collect();
        store::sha256_bytes(text.as_bytes())
    }

    /// Returns the record of the finished stage, with the note `skipped`. Otherwise has `work` make it, as
    /// [`StagePlan::run`] does, and writes it after all other outputs. `claimed` holds the record too, unless any
    /// file in its place may be replaced.
    ///
    /// # Errors
    /// Those of [`StagePlan::run`], and when the record cannot be read or written.
    pub fn make<S: AsRef<str>, R: Record, E: From<StoreError>>(
        &self,
        (record, skipped): (&str, &str),
        claimed: impl IntoIterator<Item = S>,
        progress: &dyn Progress,
        work: impl FnOnce(&mut StageOutputs<'_>) -> Result<R, E>,
    ) -> Result<R, E> {
        if self.is_done() {
            progress.note(skipped);
            return Ok(store::read_record(&self.folder.join(record))?);
        }
        self.run(claimed, progress, |outputs| {
            outputs.kept.push(record.to_owned());
            let made = work(outputs)?;
            outputs.write_record(record, &made)?;
            Ok(made)
        })
    }

    /// Has `work` write into the stage's folder: creates and locks the folder, claims files, and records the outputs
    /// that `work` has added.
    ///
    /// # Errors
    /// Those of [`FolderLock::take`]; [`StoreError::Refused`], before anything is written, where a file that the
    /// stage has not made has a claimed name; those of `work`, which leave the stage started. Also when a record of
    /// the stage cannot be written or removed.
    pub fn run<S: AsRef<str>, T, E: From<StoreError>>(
        &self,
        claimed: impl IntoIterator<Item = S>,
        progress: &dyn Progress,
        work: impl FnOnce(&mut StageOutputs<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        let _lock = FolderLock::take(&self.folder, progress)?;
        let claimed = claimed.into_iter().map(|file| file.as_ref().to_owned());
        let claimed: Vec<String> = claimed.collect();
        self.claim(&claimed)?;
        let mut outputs = StageOutputs::new(self, claimed);
        let made = work(&mut outputs)?;
        outputs.finish()?;
        Ok(made)
    }

    /// Returns whether a done-record with the same inputs exists and all its outputs are as they were made. An
    /// unreadable done-record means that the stage is not done. Removes leftovers of a process that was killed just
    /// after the stage was done.
    pub fn is_done(&self) -> bool {
        let Ok(done) = store::read_record::<Done>(&self.record_path()) else {
            return false;
        };
        let is_done = done.inputs_sha256 == self.inputs_sha256()
            && done.outputs.iter().all(|output| self.stands(output));
        if is_done {
            self.end_interrupted();
        }
        is_done
    }

    /// Removes leftovers of a process that was killed when only its own clean-up remained.
    fn end_interrupted(&self) {
        let begun = self.begun_path();
        if begun.exists() || self.folder.join(LOCK_FILE).exists() {
            // Where another process works, or nothing can be written, the file stays: it is hidden, and the next
            // process that writes takes it over.
            let _ = FolderLock::take(&self.folder, &Silent).and_then(|_lock| store::remove(&begun));
        }
    }

    fn stands(&self, output: &StageOutput) -> bool {
        let path = self.folder.join(&output.file);
        // Sizes first: they cost nothing.
        fs::metadata(&path).is_ok_and(|metadata| metadata.len() == output.bytes)
            && output
                .sha256
                .as_ref()
                .is_none_or(|sha256| store::sha256_file(&path).is_ok_and(|found| found == *sha256))
    }

    /// Returns the time that the stage took when it last ran; `None` where it has not finished.
    pub fn took(&self) -> Option<Elapsed> {
        let done = store::read_record::<Done>(&self.record_path()).ok()?;
        Some(done.took)
    }

    /// Returns whether this stage has started or finished in its folder already.
    pub fn has_begun(&self) -> bool {
        self.record_path().is_file() || self.begun_path().is_file()
    }

    /// Refuses a folder of this name that is not empty, where the stage has never started: its files in there are not
    /// known beforehand.
    ///
    /// # Errors
    /// When there is one, or the name leads through a link.
    pub fn refuse_foreign_folder(&self, name: &str) -> Result<(), StoreError> {
        let path = path_inside(&self.folder, name)?;
        let is_filled = path.exists() && !(path.is_dir() && store::names_in(&path)?.is_empty());
        if is_filled && !self.has_begun() {
            let reason = "is there, and no run of ours made it; choose another output";
            return Err(StoreError::refused(&path, reason));
        }
        Ok(())
    }

    /// Returns the files of the folder that this stage made, finished or not.
    pub fn own_files(&self) -> OwnFiles {
        let done = store::read_record::<Done>(&self.record_path());
        let begun = store::read_record::<StageStart>(&self.begun_path());
        let finished = done.into_iter().flat_map(|done| done.outputs);
        let finished = finished.map(|StageOutput { file, sha256, .. }| OwnFile { file, sha256 });
        let begun = begun.into_iter().flat_map(|begun| begun.files);
        OwnFiles::new(&self.folder, finished.chain(begun))
    }

    /// Claims files that the stage is about to write. From here on it is not done, because its outputs may be partly
    /// new. Removes half-written files of killed processes beside the outputs.
    fn claim(&self, files: &[String]) -> Result<(), StoreError> {
        let own = self.own_files();
        let mut folders = BTreeSet::from([self.folder.clone(), self.records_folder()]);
        for file in files {
            own.refuse_foreign(file)?;
            folders.extend(self.folder.join(file).parent().map(Path::to_owned));
        }
        let planned = files.iter().map(|file| OwnFile {
            file: file.clone(),
            sha256: None,
        });
        self.write_begun(own.files().chain(planned))?;
        store::remove(&self.record_path())?;
        folders
            .iter()
            .try_for_each(|folder| store::remove_abandoned(folder))
    }

    /// Moves files from a staging folder to their places in the stage's folder: all of them or, when one is refused,
    /// none. No file is missing at any time. Returns the files that are the stage's own afterwards; a user's file
    /// that has the same content already stays the user's.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where a file would be lost that this stage has not made or that was changed since, and
    /// when a file cannot be moved.
    pub fn publish(&self, staged: &Path, files: &[String]) -> Result<Vec<OwnFile>, StoreError> {
        let own = self.own_files();
        let mut moved = Vec::new();
        for file in files {
            let sha256 = store::sha256_file(&staged.join(file))?;
            let standing = own.refuse_changed(file, &sha256)?;
            if matches!(standing, NameState::Nothing | NameState::Ours) {
                moved.push(OwnFile {
                    file: file.clone(),
                    sha256: Some(sha256),
                });
            }
        }
        self.write_begun(own.files().chain(moved.iter().cloned()))?;
        for OwnFile { file, .. } in &moved {
            let target = self.folder.join(file);
            if let Some(parent) = target.parent() {
                store::create_folder(parent)?;
            }
            store::rename(&staged.join(file), &target)
                .map_err(|error| StoreError::write(&target, error))?;
        }
        Ok(moved)
    }

    /// Writes the done-record for outputs given relative to the stage's folder.
    ///
    /// # Errors
    /// When an output is missing or the record cannot be written.
    pub fn finish<S: AsRef<str>>(
        &self,
        outputs: impl IntoIterator<Item = S>,
        took: impl Into<Elapsed>,
    ) -> Result<(), StoreError> {
        let unhashed = |file: S| OwnFile {
            file: file.as_ref().to_owned(),
            sha256: None,
        };
        self.finish_hashed(outputs.into_iter().map(unhashed), took)
    }

    /// Writes the done-record as [`StagePlan::finish`] does, with the SHA-256 of outputs that were hashed on writing;
    /// the others are read for it.
    ///
    /// # Errors
    /// Those of [`StagePlan::finish`].
    pub fn finish_hashed(
        &self,
        outputs: impl IntoIterator<Item = OwnFile>,
        took: impl Into<Elapsed>,
    ) -> Result<(), StoreError> {
        let outputs = outputs.into_iter().map(|output| self.output(output));
        let recorded = outputs.collect::<Result<_, _>>()?;
        store::create_folder(&self.records_folder())?;
        store::write_record(
            &self.record_path(),
            &Done {
                stage: self.stage.clone(),
                inputs_sha256: self.inputs_sha256(),
                inputs: self.inputs.clone(),
                outputs: recorded,
                took: took.into(),
            },
        )?;
        store::remove(&self.begun_path())
    }

    /// Adds `files` to the done-record of this stage, with their present content where no hash is given. They are
    /// files of a finished stage that another step has completed, and further ones that belong to them. Those for
    /// which `is_gone` holds are removed from the outputs.
    ///
    /// # Errors
    /// When the stage has not finished, a file is missing, or the record cannot be written.
    pub fn amend(
        &self,
        files: impl IntoIterator<Item = OwnFile>,
        is_gone: impl Fn(&str) -> bool,
    ) -> Result<(), StoreError> {
        let mut done: Done = store::read_record(&self.record_path())?;
        done.outputs.retain(|output| !is_gone(&output.file));
        for file in files {
            let output = self.output(file)?;
            let mut outputs = done.outputs.iter_mut();
            match outputs.find(|known| known.file == output.file) {
                Some(known) => *known = output,
                None => done.outputs.push(output),
            }
        }
        store::write_record(&self.record_path(), &done)?;
        store::remove(&self.begun_path())
    }

    /// Returns the entry of an existing file, with its hash where that is known.
    fn output(&self, OwnFile { file, sha256 }: OwnFile) -> Result<StageOutput, StoreError> {
        let path = self.folder.join(&file);
        let metadata = fs::metadata(&path).map_err(|source| StoreError::write(&path, source))?;
        Ok(StageOutput {
            file,
            bytes: metadata.len(),
            sha256: Some(sha256.map_or_else(|| store::sha256_file(&path), Ok)?),
        })
    }

    fn write_begun(&self, files: impl Iterator<Item = OwnFile>) -> Result<(), StoreError> {
        path_inside(&self.folder, RECORDS_FOLDER)?;
        store::create_folder(&self.records_folder())?;
        let files: BTreeSet<OwnFile> = files.collect();
        let begun = StageStart {
            stage: self.stage.clone(),
            files: files.into_iter().collect(),
        };
        store::write_record(&self.begun_path(), &begun)
    }

    fn records_folder(&self) -> PathBuf {
        self.folder.join(RECORDS_FOLDER)
    }

    fn record_path(&self) -> PathBuf {
        self.records_folder().join(format!("{}.json", self.stage))
    }

    fn begun_path(&self) -> PathBuf {
        self.records_folder()
            .join(format!("{}.begun.json", self.stage))
    }
}
