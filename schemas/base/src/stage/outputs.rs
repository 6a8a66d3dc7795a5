//! Outputs of a running stage.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use super::StagePlan;
use crate::{
    elapsed::Stopwatch,
    ownership::OwnFile,
    store::{self, Record, StoreError},
};

/// Files that a running stage has written, for its done-record. Files that are written through it are hashed once, on
/// the way.
#[derive(Debug)]
pub struct StageOutputs<'a> {
    plan: &'a StagePlan,
    clock: Stopwatch,
    files: Vec<OwnFile>,
    /// Files that are kept where others are replaced: those that were claimed, and the record.
    pub(super) kept: Vec<String>,
    is_left_begun: bool,
}

impl<'a> StageOutputs<'a> {
    pub(super) fn new(plan: &'a StagePlan, kept: Vec<String>) -> Self {
        Self {
            plan,
            clock: Stopwatch::with_children(),
            files: Vec::new(),
            kept,
            is_left_begun: false,
        }
    }

    /// Returns the path of a file in the stage's folder.
    pub fn path(&self, file: &str) -> PathBuf {
        self.plan.folder.join(file)
    }

    /// Has the stage's time count from an earlier moment than its claim.
    pub fn count_from(&mut self, clock: Stopwatch) {
        self.clock = clock;
    }

    /// Adds an existing file of the stage's folder.
    pub fn add(&mut self, file: impl Into<String>) {
        let file = file.into();
        self.files.push(OwnFile { file, sha256: None });
    }

    /// Adds existing files of the stage's folder.
    pub fn add_all<S: Into<String>>(&mut self, files: impl IntoIterator<Item = S>) {
        files.into_iter().for_each(|file| self.add(file));
    }

    /// Adds an existing file of the stage's folder whose SHA-256 is known.
    pub fn add_hashed(&mut self, file: OwnFile) {
        self.files.push(file);
    }

    /// Returns true where a file has been added.
    pub fn has(&self, file: &str) -> bool {
        self.files.iter().any(|added| added.file == file)
    }

    /// Writes a file and adds it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_bytes(&mut self, file: &str, bytes: &[u8]) -> Result<(), StoreError> {
        store::write_bytes(&self.path(file), bytes)?;
        self.files.push(OwnFile {
            file: file.to_owned(),
            sha256: Some(store::sha256_bytes(bytes)),
        });
        Ok(())
    }

    /// Writes a record and adds it.
    ///
    /// # Errors
    /// Those of [`store::write_record`].
    pub fn write_record<T: Record>(&mut self, file: &str, record: &T) -> Result<(), StoreError> {
        let sha256 = Some(store::write_record_hashed(&self.path(file), record)?);
        let file = file.to_owned();
        self.files.push(OwnFile { file, sha256 });
        Ok(())
    }

    /// Moves files into the stage's folder, as [`StagePlan::publish`], and adds those that are its own.
    ///
    /// # Errors
    /// Those of [`StagePlan::publish`].
    pub fn place(&mut self, staged: &Path, files: &[String]) -> Result<(), StoreError> {
        self.files.extend(self.plan.publish(staged, files)?);
        Ok(())
    }

    /// Places files, see [`StageOutputs::place`], and removes all other files of the stage except the claimed ones.
    ///
    /// # Errors
    /// Those of [`StageOutputs::place`], and when a file cannot be removed.
    pub fn replace(&mut self, staged: &Path, files: &[String]) -> Result<(), StoreError> {
        self.place(staged, files)?;
        let kept: BTreeSet<&str> = files.iter().chain(&self.kept).map(String::as_str).collect();
        self.plan.own_files().remove(|file| !kept.contains(file))
    }

    /// Leaves the stage unfinished when its work is over, so that it runs again.
    pub fn leave_begun(&mut self) {
        self.is_left_begun = true;
    }

    pub(super) fn finish(self) -> Result<(), StoreError> {
        if self.is_left_begun {
            return Ok(());
        }
        self.plan.finish_hashed(self.files, self.clock.elapsed())
    }
}
