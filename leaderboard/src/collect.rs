//! Finding results, and the protocols that they were scored under.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{Protocol, ResultRecord, Split},
    store::{self, StoreError},
};

use crate::error::LeaderboardError;

/// Name of the files of scores.
const RESULT_FILE: &str = "result.json";

/// Name of the files that hold a protocol whole.
const SPLIT_FILE: &str = "split.json";

/// Reads every `result.json` in `folder` and below, sorted by path. Links to folders are followed,
/// each folder is visited once. Hidden folders hold what is half-written or superseded, and no
/// results.
///
/// # Errors
/// When a folder cannot be listed, a result cannot be read (one broken result is an error: left
/// out, it would go unnoticed) or there is none.
pub fn collect(folder: &Path) -> Result<Vec<(PathBuf, ResultRecord)>, LeaderboardError> {
    let files = find_all(folder, RESULT_FILE)?;
    if files.is_empty() {
        return Err(LeaderboardError::NoResults {
            folder: folder.to_owned(),
        });
    }
    files
        .into_iter()
        .map(|file| {
            let record = store::read_record(&file)?;
            Ok((file, record))
        })
        .collect()
}

/// The protocols of every `split.json` in `folder` and below, by hash. A protocol that does not
/// have the hash beside it is left out: its rules are not those of the scores.
///
/// # Errors
/// When a folder cannot be listed or a split cannot be read.
pub(crate) fn collect_protocols(
    folder: &Path,
) -> Result<BTreeMap<String, Protocol>, LeaderboardError> {
    let mut protocols = BTreeMap::new();
    for file in find_all(folder, SPLIT_FILE)? {
        let split: Split = store::read_record(&file)?;
        if split.protocol.hash() == split.protocol_hash {
            protocols.insert(split.protocol_hash, split.protocol);
        }
    }
    Ok(protocols)
}

/// All files of a name in `folder` and below, sorted.
fn find_all(folder: &Path, name: &str) -> Result<Vec<PathBuf>, StoreError> {
    let mut files = Vec::new();
    find(folder, name, &mut BTreeSet::new(), &mut files)?;
    files.sort();
    Ok(files)
}

fn find(
    folder: &Path,
    name: &str,
    visited: &mut BTreeSet<PathBuf>,
    files: &mut Vec<PathBuf>,
) -> Result<(), StoreError> {
    let failed = |source| StoreError::read(folder, source);
    // Links may form circles and may lead to one folder twice.
    if !visited.insert(fs::canonicalize(folder).map_err(failed)?) {
        return Ok(());
    }
    // The order decides which of two links to one folder gives the path, so it must be fixed.
    for path in store::paths_in(folder)? {
        if path.is_dir() && !is_hidden(&path) {
            find(&path, name, visited, files)?;
        } else if path.file_name().is_some_and(|found| found == name) {
            files.push(path);
        }
    }
    Ok(())
}

fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}
