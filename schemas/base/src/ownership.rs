//! Ownership of files in a folder: this program replaces and removes only files that it made.
//!
//! A file is ours where a list of ours names it and its content still has the listed hash. Files that the user added
//! or changed are the user's. Links below the folder are never followed.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    io::{self, Read},
    path::{Component, Path, PathBuf},
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::{self, Record, StoreError};

/// A file that this program makes or has made.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct OwnFile {
    /// Relative to its folder, with `/` between folders.
    pub file: String,
    /// SHA-256 of its content; `None` while that is not known.
    pub sha256: Option<String>,
}

/// The files that a command keeps in a folder, beside what others have there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FileList {
    /// The files.
    pub files: Vec<OwnFile>,
}

impl Record for FileList {
    const SCHEMA: &'static str = "omnilife/file-list/1";
}

/// Files of a folder that this program made.
#[derive(Debug, Clone)]
pub struct OwnFiles {
    folder: PathBuf,
    /// Hashes that a file of ours may have.
    hashes: BTreeMap<String, BTreeSet<String>>,
}

/// State of a name in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NameState {
    /// The name is free.
    Nothing,
    /// A file of ours with the content that we wrote.
    Ours,
    /// A file that we made and that was changed since; or one that we were about to make.
    Changed,
    /// Anything else.
    Foreign,
}

impl OwnFiles {
    /// Makes the set of the files that a list names.
    pub fn new(folder: &Path, files: impl IntoIterator<Item = OwnFile>) -> Self {
        let mut hashes: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for file in files {
            hashes.entry(file.file).or_default().extend(file.sha256);
        }
        Self {
            folder: folder.to_owned(),
            hashes,
        }
    }

    /// Returns the listed files.
    pub fn files(&self) -> impl Iterator<Item = OwnFile> + '_ {
        self.hashes.iter().flat_map(|(file, hashes)| {
            let known = hashes.iter().cloned().map(Some);
            let unknown = hashes.is_empty().then_some(None);
            known.chain(unknown).map(|sha256| OwnFile {
                file: file.clone(),
                sha256,
            })
        })
    }

    /// Returns the state of a name.
    ///
    /// # Errors
    /// When the name leads out of the folder, or the file cannot be read.
    pub fn standing(&self, file: &str) -> Result<NameState, StoreError> {
        let path = path_inside(&self.folder, file)?;
        let metadata = match fs::symlink_metadata(&path) {
            Err(error) if is_absence(&error) => return Ok(NameState::Nothing),
            metadata => metadata.map_err(|error| StoreError::read(&path, error))?,
        };
        match self.hashes.get(file) {
            Some(hashes) if metadata.is_file() => {
                let is_ours = !hashes.is_empty() && hashes.contains(&store::sha256_file(&path)?);
                Ok(if is_ours {
                    NameState::Ours
                } else {
                    NameState::Changed
                })
            }
            _ => Ok(NameState::Foreign),
        }
    }

    /// Refuses to write a file where a foreign one exists.
    ///
    /// # Errors
    /// When one exists, a folder has the name, or the name leads out of the folder.
    pub fn refuse_foreign(&self, file: &str) -> Result<(), StoreError> {
        match self.standing(file)? {
            NameState::Foreign => Err(in_the_way(&self.folder.join(file))),
            NameState::Nothing | NameState::Ours | NameState::Changed => Ok(()),
        }
    }

    /// Refuses to replace a file that differs from the one that we made, unless it has this content already. Returns
    /// the state of the name.
    ///
    /// # Errors
    /// When a foreign or changed file has the name, or the name leads out of the folder.
    pub fn refuse_changed(&self, file: &str, sha256: &str) -> Result<NameState, StoreError> {
        let path = self.folder.join(file);
        match self.standing(file)? {
            standing @ (NameState::Nothing | NameState::Ours) => Ok(standing),
            standing if path.is_file() && store::sha256_file(&path)? == sha256 => Ok(standing),
            NameState::Changed | NameState::Foreign => Err(in_the_way(&path)),
        }
    }

    /// Removes the listed files that are unchanged and that `goes` accepts, with the folders that become empty.
    /// Everything else stays.
    ///
    /// # Errors
    /// When a file cannot be read or removed.
    pub fn remove(&self, goes: impl Fn(&str) -> bool) -> Result<(), StoreError> {
        for file in self.hashes.keys().filter(|file| goes(file)) {
            // Targets of links, and names outside of the folder in a damaged list, are not ours.
            if !matches!(self.standing(file), Ok(NameState::Ours)) {
                continue;
            }
            let path = self.folder.join(file);
            store::remove(&path)?;
            let folders = path.ancestors().skip(1);
            for folder in folders.take_while(|folder| *folder != self.folder) {
                // A folder with other entries stays.
                if fs::remove_dir(folder).is_err() {
                    break;
                }
            }
        }
        Ok(())
    }
}

/// Returns whether a name of a record is that of a file in the record's folder or below: relative, without `..`, not
/// empty. Links are not checked.
pub fn is_inside(file: &str) -> bool {
    let mut parts = Path::new(file).components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// Returns the path of a file in a folder.
///
/// # Errors
/// When the name is empty, absolute, has a part `.` or `..`, or leads through a link.
pub fn path_inside(folder: &Path, file: &str) -> Result<PathBuf, StoreError> {
    if !is_inside(file) {
        let reason = format!("{file:?} must be a relative path inside the folder");
        return Err(StoreError::refused(folder, reason));
    }
    let mut path = folder.to_owned();
    for part in Path::new(file) {
        path.push(part);
        if path.is_symlink() {
            return Err(StoreError::refused(
                &path,
                "is a link; nothing is read, written or removed through links in a folder",
            ));
        }
    }
    Ok(path)
}

/// Refuses to write a single file over an existing one of any origin. Removes half-written files of killed processes
/// beside it.
///
/// # Errors
/// When there is anything under the name.
pub fn refuse_existing(path: &Path) -> Result<(), StoreError> {
    remove_abandoned_beside(path)?;
    match fs::symlink_metadata(path) {
        Err(error) if is_absence(&error) => Ok(()),
        Err(error) => Err(StoreError::read(path, error)),
        Ok(_) => Err(StoreError::refused(
            path,
            "exists already and is not replaced; remove it or choose another name",
        )),
    }
}

/// Refuses to write a single file over one that does not start with `beginning`. Removes half-written files of killed
/// processes beside it.
///
/// # Errors
/// When there is something else under the name.
pub fn refuse_another_kind(path: &Path, beginning: &[u8]) -> Result<(), StoreError> {
    remove_abandoned_beside(path)?;
    let failed = |error| StoreError::read(path, error);
    let mut file = match fs::File::open(path) {
        Err(error) if is_absence(&error) => return Ok(()),
        file => file.map_err(failed)?,
    };
    let mut found = Vec::new();
    let most = beginning.len() as u64;
    file.by_ref()
        .take(most)
        .read_to_end(&mut found)
        .map_err(failed)?;
    if found == beginning {
        return Ok(());
    }
    Err(StoreError::refused(
        path,
        "is something else and is not replaced; choose another name",
    ))
}

fn remove_abandoned_beside(path: &Path) -> Result<(), StoreError> {
    let parent = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty());
    let folder = parent.unwrap_or(Path::new("."));
    // Names below a file are refused when they are written.
    if folder.is_dir() {
        store::remove_abandoned(folder)?;
    }
    Ok(())
}

fn in_the_way(path: &Path) -> StoreError {
    StoreError::refused(
        path,
        "is in the way: it was not made here, or was changed since; move it or choose another output",
    )
}

/// Returns whether the path does not exist, or leads through a file.
fn is_absence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
    )
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    fn listed(file: &str, content: &str) -> OwnFile {
        OwnFile {
            file: file.to_owned(),
            sha256: Some(store::sha256_bytes(content.as_bytes())),
        }
    }

    #[test]
    fn only_unchanged_files_of_ours_are_removed() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path();
        fs::create_dir_all(folder.join("a/b")).unwrap();
        fs::create_dir_all(folder.join("tree")).unwrap();
        for file in ["a/b/ours.png", "a/changed.png", "a/foreign.png", "tree/x"] {
            fs::write(folder.join(file), file).unwrap();
        }
        let mut list: Vec<OwnFile> = ["a/b/ours.png", "tree"].map(|f| listed(f, f)).into();
        list.push(listed("a/changed.png", "as it was"));
        list.extend(["", "/etc/hostname", "../x", "a/none.png"].map(|file| listed(file, file)));
        let ours = OwnFiles::new(folder, list);
        ours.remove(|_| true).unwrap();
        assert!(!folder.join("a/b").exists());
        for kept in ["a/changed.png", "a/foreign.png", "tree/x"] {
            assert!(folder.join(kept).is_file(), "{kept}");
        }
        assert_eq!(ours.standing("a/changed.png").unwrap(), NameState::Changed);
        assert_eq!(ours.standing("a/foreign.png").unwrap(), NameState::Foreign);
        assert_eq!(ours.standing("tree").unwrap(), NameState::Foreign);
        assert_eq!(ours.standing("a/none.png").unwrap(), NameState::Nothing);
        assert!(ours.refuse_foreign("a/foreign.png").is_err());
        let held = store::sha256_bytes(b"a/foreign.png");
        ours.refuse_changed("a/foreign.png", &held).unwrap();
        assert!(ours.refuse_changed("a/foreign.png", "other").is_err());
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed_out_of_a_folder() {
        let temp = tempfile::tempdir().unwrap();
        let (folder, outside) = (temp.path().join("out"), temp.path().join("outside"));
        fs::create_dir(&folder).unwrap();
        fs::create_dir(&outside).unwrap();
        fs::write(outside.join("f"), "mine").unwrap();
        std::os::unix::fs::symlink(&outside, folder.join("link")).unwrap();
        std::os::unix::fs::symlink(outside.join("f"), folder.join("f")).unwrap();
        let ours = OwnFiles::new(&folder, ["link/f", "f"].map(|file| listed(file, "mine")));
        ours.remove(|_| true).unwrap();
        assert!(outside.join("f").is_file() && folder.join("f").is_symlink());
        for name in ["link/f", "f", "link/new", "..", "a/../../b", "/f", ""] {
            assert!(path_inside(&folder, name).is_err(), "{name:?}");
        }
        assert!(path_inside(&folder, "new/file").is_ok());
    }
}
