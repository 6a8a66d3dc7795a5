//! The files of a leaderboard: written, or compared with what is there.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use omnilife_schemas::store::{self, StoreError};

use crate::error::LeaderboardError;

/// List of what the last build made, one path and SHA-256 per line.
pub(crate) const MANIFEST: &str = "files.txt";

/// Content of a file to be.
#[derive(Debug)]
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

    /// Writes all files into `out`, removes those that an earlier build made and this one does
    /// not, and lists them in [`MANIFEST`].
    pub(crate) fn write(&self, out: &Path) -> Result<(), StoreError> {
        for path in earlier_files(out)? {
            if !self.files.contains_key(&path) {
                store::remove(&out.join(path))?;
            }
        }
        let mut manifest = String::new();
        for (path, content) in &self.files {
            let target = out.join(path);
            if let Some(folder) = target.parent() {
                store::create_folder(folder)?;
            }
            let bytes = content.bytes()?;
            // What is the same already is left alone: a rebuilt site uploads what changed.
            if fs::read(&target).ok().as_deref() != Some(&*bytes) {
                store::write_bytes(&target, &bytes)?;
            }
            manifest.push_str(&format!("{}  {path}\n", store::sha256_bytes(&bytes)));
        }
        store::write_bytes(&out.join(MANIFEST), manifest.as_bytes())
    }

    /// Compares all files with those in `out`, and asks of earlier files that `is_checked` accepts
    /// whether they still belong there.
    ///
    /// # Errors
    /// When one is missing, differs, or stands there from an earlier build.
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
            .into_iter()
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

/// Files that the manifest of an earlier build lists and that are inside `out`.
fn earlier_files(out: &Path) -> Result<BTreeSet<String>, StoreError> {
    let path = out.join(MANIFEST);
    let text = match fs::read_to_string(&path) {
        Ok(text) => text,
        Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
        Err(source) => return Err(StoreError::read(&path, source)),
    };
    let paths = text.lines().filter_map(|line| line.split_once("  "));
    Ok(paths
        .map(|(_, path)| path.to_owned())
        // Nobody's file outside the folder is removed, whatever the manifest says.
        .filter(|path| {
            let mut parts = Path::new(path).components();
            parts.all(|part| matches!(part, std::path::Component::Normal(_)))
        })
        .collect())
}
