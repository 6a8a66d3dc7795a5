//! The files of a leaderboard: written, or compared with existing ones.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    ownership::{FileList, OwnFile, OwnFiles},
    store::{self, StoreError},
};

use rayon::prelude::*;

use crate::error::LeaderboardError;

/// List of the files of the last build.
const MANIFEST: &str = ".omnilife-leaderboard.json";

/// Planned content of a file.
#[derive(Debug, Clone)]
pub(crate) enum Content {
    Bytes(Vec<u8>),
    /// The bytes of another file.
    CopyOf(PathBuf),
}

/// Files by path relative to the output folder, with `/` between folders.
#[derive(Debug, Default)]
pub(crate) struct Outputs {
    files: BTreeMap<String, Content>,
}

impl Outputs {
    pub(crate) fn add(&mut self, path: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.into(), Content::Bytes(bytes.into()));
    }

    pub(crate) fn add_copy(&mut self, path: impl Into<String>, source: PathBuf) {
        self.files.insert(path.into(), Content::CopyOf(source));
    }

    /// Returns true if there is a file under this path.
    pub(crate) fn has(&self, path: &str) -> bool {
        self.files.contains_key(path)
    }

    /// Adds the content of one of its files under another path too; nothing without that file.
    pub(crate) fn repeat(&mut self, path: &str, target: String) {
        if let Some(content) = self.files.get(path).cloned() {
            self.files.insert(target, content);
        }
    }

    /// Takes the files of other outputs over.
    pub(crate) fn append(&mut self, other: Self) {
        self.files.extend(other.files);
    }

    /// Writes all files into `out`, removes those of an earlier build that this one does not make, and lists them in
    /// [`MANIFEST`].
    ///
    /// # Errors
    /// When a foreign or changed file is in the way: nothing is written then.
    pub(crate) fn write(&self, out: &Path) -> Result<(), StoreError> {
        let earlier = earlier_files(out)?;
        let hashed: Vec<Result<OwnFile, StoreError>> = (self.files.par_iter())
            .map(|(path, content)| {
                let sha256 = store::sha256_bytes(&content.bytes()?);
                earlier.refuse_changed(path, &sha256)?;
                Ok(OwnFile {
                    file: path.clone(),
                    sha256: Some(sha256),
                })
            })
            .collect();
        // In the order of the paths, so that the named one in the way is always the first.
        let files = hashed.into_iter().collect::<Result<Vec<_>, _>>()?;
        let manifest = out.join(MANIFEST);
        let folders: BTreeSet<_> = self
            .files
            .keys()
            .filter_map(|path| Path::new(path).parent())
            .collect();
        for folder in folders {
            store::remove_abandoned(&out.join(folder))?;
        }
        // If a build is killed, both its old and its new files are known as ours.
        let mut list = FileList {
            files: earlier.files().chain(files.iter().cloned()).collect(),
        };
        store::update_record(&manifest, &list)?;
        earlier.remove(|path| !self.files.contains_key(path))?;
        let folders: BTreeSet<&Path> = (self.files.keys())
            .filter_map(|path| Path::new(path).parent())
            .collect();
        for folder in folders {
            store::create_folder(&out.join(folder))?;
        }
        let written: Vec<Result<(), StoreError>> = (self.files.par_iter())
            .map(|(path, content)| {
                let target = out.join(path);
                let bytes = content.bytes()?;
                // Equal files are left alone: a rebuilt site uploads only changes.
                if fs::read(&target).ok().as_deref() == Some(&*bytes) {
                    return Ok(());
                }
                store::write_bytes(&target, &bytes)
            })
            .collect();
        written.into_iter().collect::<Result<(), _>>()?;
        list.files = files;
        store::update_record(&manifest, &list)
    }

    /// Compares all files with those in `out`, and checks whether earlier files accepted by `is_checked` still belong
    /// there.
    ///
    /// # Errors
    /// When one is missing, differs, or is left over from an earlier build.
    pub(crate) fn check(
        &self,
        out: &Path,
        is_checked: impl Fn(&str) -> bool,
    ) -> Result<(), LeaderboardError> {
        for (path, content) in &self.files {
            let target = out.join(path);
            let found = match fs::read(&target) {
                Ok(found) => Some(found),
                Err(source) if source.kind() == io::ErrorKind::NotFound => None,
                Err(source) => return Err(StoreError::read(&target, source).into()),
            };
            let reason = match found {
                None => "is missing",
                Some(found) if *found != *content.bytes()? => "is not what the results give",
                Some(_) => continue,
            };
            return Err(LeaderboardError::OutOfDate {
                path: target,
                reason: reason.to_owned(),
            });
        }
        match earlier_files(out)?
            .files()
            .map(|earlier| earlier.file)
            .find(|path| is_checked(path) && !self.files.contains_key(path))
        {
            Some(path) => Err(LeaderboardError::OutOfDate {
                path: out.join(path),
                reason: "is of an earlier build".to_owned(),
            }),
            None => Ok(()),
        }
    }
}

impl Content {
    fn bytes(&self) -> Result<std::borrow::Cow<'_, [u8]>, StoreError> {
        Ok(match self {
            Self::Bytes(bytes) => bytes.into(),
            Self::CopyOf(source) => fs::read(source)
                .map_err(|error| StoreError::read(source, error))?
                .into(),
        })
    }
}

/// Returns files in the manifest of an earlier build.
fn earlier_files(out: &Path) -> Result<OwnFiles, StoreError> {
    let path = out.join(MANIFEST);
    let files = if path.is_file() {
        store::read_record::<FileList>(&path)?.files
    } else {
        Vec::new()
    };
    Ok(OwnFiles::new(out, files))
}
