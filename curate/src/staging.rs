//! A hidden folder for files that are not complete yet.

use std::path::{Path, PathBuf};

use omnilife_schemas::store::{self, StoreError, Unfinished};

/// The folder; removed on drop with its content.
pub(crate) struct Staging {
    /// Its path.
    pub(crate) folder: PathBuf,
    /// The files started in it, relative to it.
    pub(crate) files: Vec<String>,
    _unfinished: Unfinished,
}

impl Staging {
    /// Creates one in `parent`, after removing those of killed processes.
    pub(crate) fn new(parent: &Path, name: &str) -> Result<Self, StoreError> {
        store::remove_abandoned(parent)?;
        let unfinished = Unfinished::folder_beside(&parent.join(name))?;
        Ok(Self {
            folder: unfinished.path().to_owned(),
            files: Vec::new(),
            _unfinished: unfinished,
        })
    }

    /// Returns the path for writing a file that will be named `file`.
    pub(crate) fn begin(&mut self, file: &str) -> Result<PathBuf, StoreError> {
        let path = self.folder.join(file);
        if let Some(parent) = path.parent() {
            store::create_folder(parent)?;
        }
        self.files.push(file.to_owned());
        Ok(path)
    }
}
