//! A hidden folder in which files are made before they get their places.

use std::path::{Path, PathBuf};

use omnilife_schemas::store::{self, StoreError, Unfinished};

/// The folder; removed with what is left in it.
pub(crate) struct Staging {
    /// Where it is.
    pub(crate) folder: PathBuf,
    /// The files that were begun in it, relative to it.
    pub(crate) files: Vec<String>,
    _unfinished: Unfinished,
}

impl Staging {
    /// Makes one in `parent`, after removing those that killed processes left there.
    pub(crate) fn new(parent: &Path, name: &str) -> Result<Self, StoreError> {
        store::remove_abandoned(parent)?;
        let unfinished = Unfinished::folder_beside(&parent.join(name))?;
        Ok(Self {
            folder: unfinished.path().to_owned(),
            files: Vec::new(),
            _unfinished: unfinished,
        })
    }

    /// Where to write a file that will be called `file`.
    pub(crate) fn begin(&mut self, file: &str) -> Result<PathBuf, StoreError> {
        let path = self.folder.join(file);
        if let Some(parent) = path.parent() {
            store::create_folder(parent)?;
        }
        self.files.push(file.to_owned());
        Ok(path)
    }
}
