//! Hidden folders for files that are not complete yet.

use std::path::{Path, PathBuf};

use crate::store::{self, StoreError, Unfinished};

/// Staging folder; removed on drop with its content.
pub struct Staging {
    /// Its path.
    pub folder: PathBuf,
    /// Files started in it, relative to it.
    pub files: Vec<String>,
    _unfinished: Unfinished,
}

impl Staging {
    /// Creates a folder in `parent`, after removing those of killed processes.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn new(parent: &Path, name: &str) -> Result<Self, StoreError> {
        store::remove_abandoned(parent)?;
        let unfinished = Unfinished::folder_beside(&parent.join(name))?;
        Ok(Self {
            folder: unfinished.path().to_owned(),
            files: Vec::new(),
            _unfinished: unfinished,
        })
    }

    /// Returns the path for writing a file that will be named `file`.
    ///
    /// # Errors
    /// When its folder cannot be created.
    pub fn begin(&mut self, file: &str) -> Result<PathBuf, StoreError> {
        let path = self.folder.join(file);
        if let Some(parent) = path.parent() {
            store::create_folder(parent)?;
        }
        self.files.push(file.to_owned());
        Ok(path)
    }
}
