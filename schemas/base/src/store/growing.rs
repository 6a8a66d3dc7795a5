//! Files that others read while they grow.

use std::{
    fs::{File, OpenOptions},
    io::Write,
    path::{Path, PathBuf},
};

use super::{StoreError, create_folder};

/// File to which records are appended, for programs that read it while it grows.
///
/// Unlike every other file it has its final name from the start, so a killed process may leave a part of its last
/// record.
#[derive(Debug)]
pub struct GrowingFile {
    path: PathBuf,
    file: File,
}

impl GrowingFile {
    /// Creates the file, and its folder.
    ///
    /// # Errors
    /// When the file exists, or cannot be created.
    pub fn create(path: &Path) -> Result<Self, StoreError> {
        if let Some(folder) = path.parent() {
            create_folder(folder)?;
        }
        let file = OpenOptions::new().append(true).create_new(true).open(path);
        Ok(Self {
            path: path.to_owned(),
            file: file.map_err(|source| StoreError::write(path, source))?,
        })
    }

    /// Appends a record.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn append(&mut self, record: &[u8]) -> Result<(), StoreError> {
        let written = self.file.write_all(record);
        written.map_err(|source| StoreError::write(&self.path, source))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_follow_each_other_and_no_file_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new/log");
        let mut file = GrowingFile::create(&path).expect("created");
        for record in [b"ab", b"cd"] {
            file.append(record).expect("appended");
        }
        assert_eq!(std::fs::read(&path).expect("read"), b"abcd");
        let error = GrowingFile::create(&path).expect_err("it exists");
        assert!(error.to_string().contains("cannot be written"), "{error}");
        assert_eq!(std::fs::read(&path).expect("read"), b"abcd");
    }
}
