//! Collection of results, and of the protocols under which they were scored.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{ASSET_FILE, RESULT_FILE, SPLIT_FILE, SUBMISSION_FILE, VERIFICATION_FILE},
    records::{MethodCard, Protocol, ResultRecord, Split, Submission, Verification},
    store::{self, StoreError},
};
use rayon::prelude::*;

use crate::{
    assets::{self, FoundAsset},
    error::LeaderboardError,
};

/// Reads every `result.json` in `folder` and below, sorted by path. Links to folders are followed, each folder is
/// visited once. Hidden folders hold unfinished or superseded files, and no results.
///
/// # Errors
/// When a folder cannot be listed, a result cannot be read (one broken result is an error: an omission would go
/// unnoticed), or no result exists.
pub fn collect(folder: &Path) -> Result<Vec<(PathBuf, ResultRecord)>, LeaderboardError> {
    RecordFiles::below(folder)?.results()
}

/// The records of a folder and its subfolders.
pub(crate) struct RecordFiles {
    folder: PathBuf,
    /// Sorted.
    results: Vec<PathBuf>,
    /// Sorted.
    splits: Vec<PathBuf>,
    /// Records of submissions, sorted.
    submissions: Vec<PathBuf>,
    /// Records of their verifications, sorted.
    verifications: Vec<PathBuf>,
    /// Sorted.
    assets: Vec<PathBuf>,
}

impl RecordFiles {
    pub(crate) fn below(folder: &Path) -> Result<Self, StoreError> {
        let mut files = Self {
            folder: folder.to_owned(),
            results: Vec::new(),
            splits: Vec::new(),
            submissions: Vec::new(),
            verifications: Vec::new(),
            assets: Vec::new(),
        };
        let failed = |source| StoreError::read(folder, source);
        let real = fs::canonicalize(folder).map_err(failed)?;
        files.search(folder, real, &mut BTreeSet::new())?;
        files.results.sort();
        files.splits.sort();
        files.submissions.sort();
        files.verifications.sort();
        files.assets.sort();
        let assets = &files.assets;
        files
            .results
            .retain(|result| !assets::is_of_level(result, assets));
        Ok(files)
    }

    pub(crate) fn results(&self) -> Result<Vec<(PathBuf, ResultRecord)>, LeaderboardError> {
        if self.results.is_empty() {
            return Err(LeaderboardError::NoResults {
                folder: self.folder.clone(),
            });
        }
        let read: Vec<Result<ResultRecord, StoreError>> = self
            .results
            .par_iter()
            .map(|file| store::read_record(file))
            .collect();
        // In the order of the files, so that the named broken one is always the first.
        let files = self.results.iter().cloned();
        files
            .zip(read)
            .map(|(file, record)| Ok((file, record?)))
            .collect()
    }

    /// Returns the protocols of all results and splits, by hash. A protocol with another hash than the one stated
    /// beside it is omitted: its rules are not those of the scores.
    pub(crate) fn protocols(
        &self,
        results: &[(PathBuf, ResultRecord)],
    ) -> Result<BTreeMap<String, Protocol>, LeaderboardError> {
        let mut protocols = BTreeMap::new();
        for (_, result) in results {
            if let Some(rules) = &result.rules
                && !protocols.contains_key(&result.protocol_hash)
                && rules.hash() == result.protocol_hash
            {
                protocols.insert(result.protocol_hash.clone(), rules.clone());
            }
        }
        for file in &self.splits {
            let split: Split = store::read_record(file)?;
            if split.protocol.hash() == split.protocol_hash {
                protocols.insert(split.protocol_hash, split.protocol);
            }
        }
        Ok(protocols)
    }

    /// Returns the cards of the submitted methods, sorted by method. A method with several submissions has all its
    /// different cards.
    pub(crate) fn cards(&self) -> Result<Vec<MethodCard>, LeaderboardError> {
        let mut cards = Vec::new();
        for file in &self.submissions {
            cards.push(store::read_record::<Submission>(file)?.card);
        }
        cards.sort_by(|a, b| (&a.method, &a.title).cmp(&(&b.method, &b.title)));
        cards.dedup();
        Ok(cards)
    }

    /// Returns the counts of verified results, by method: for several submissions of one method the sum, with the
    /// latest date.
    pub(crate) fn verifications(&self) -> Result<BTreeMap<String, Verification>, LeaderboardError> {
        let mut by_method: BTreeMap<String, Verification> = BTreeMap::new();
        for file in &self.verifications {
            let found: Verification = store::read_record(file)?;
            match by_method.get_mut(&found.method) {
                Some(known) => known.add(&found),
                None => drop(by_method.insert(found.method.clone(), found)),
            }
        }
        Ok(by_method)
    }

    /// Returns all assets with the scores of their levels.
    pub(crate) fn assets(&self) -> Result<Vec<FoundAsset>, LeaderboardError> {
        let assets = self.assets.iter().map(|file| FoundAsset::read(file));
        Ok(assets.collect::<Result<_, _>>()?)
    }

    /// Searches `folder`, whose path without links is `real`.
    fn search(
        &mut self,
        folder: &Path,
        real: PathBuf,
        visited: &mut BTreeSet<PathBuf>,
    ) -> Result<(), StoreError> {
        let failed = |source| StoreError::read(folder, source);
        // Links may form circles and may lead to one folder twice.
        if !visited.insert(real.clone()) {
            return Ok(());
        }
        let mut entries = fs::read_dir(folder)
            .map_err(failed)?
            .collect::<Result<Vec<_>, _>>()
            .map_err(failed)?;
        // The order decides which of two links to one folder gives the path, so it must be fixed.
        entries.sort_by_key(fs::DirEntry::file_name);
        for entry in entries {
            let (path, name) = (entry.path(), entry.file_name());
            let kind = entry.file_type().map_err(failed)?;
            if kind.is_dir() || (kind.is_symlink() && path.is_dir()) {
                if name.as_encoded_bytes().starts_with(b".") {
                    continue;
                }
                // Without a link the path is known; querying it would take most of the time.
                let next = if kind.is_symlink() {
                    fs::canonicalize(&path).map_err(failed)?
                } else {
                    real.join(&name)
                };
                self.search(&path, next, visited)?;
            } else if name == RESULT_FILE {
                self.results.push(path);
            } else if name == SPLIT_FILE {
                self.splits.push(path);
            } else if name == SUBMISSION_FILE {
                self.submissions.push(path);
            } else if name == VERIFICATION_FILE {
                self.verifications.push(path);
            } else if name == ASSET_FILE {
                self.assets.push(path);
            }
        }
        Ok(())
    }
}
