//! A hidden folder for files that are not complete yet.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::store::{self, StoreError};

/// The folder; removed on drop with its content.
pub struct Staging {
    /// Its path.
    pub folder: PathBuf,
    /// The files started in it, relative to it.
    pub files: Vec<String>,
}

impl Staging {
    /// Creates one in `parent`, after removing those of killed processes.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn new(parent: &Path, name: &str) -> Result<Self, StoreError> {
        store::remove_abandoned(parent)?;
        let folder = store::temporary_beside(&parent.join(name));
        store::remove(&folder)?;
        store::create_folder(&folder)?;
        Ok(Self {
            folder,
            files: Vec::new(),
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

impl Drop for Staging {
    fn drop(&mut self) {
        // Nothing depends on it any more; leftovers are hidden and harmless.
        drop(fs::remove_dir_all(&self.folder));
    }
}
