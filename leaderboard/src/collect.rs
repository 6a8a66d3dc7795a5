//! Finding results.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::ResultRecord,
    store::{self, StoreError},
};

use crate::error::LeaderboardError;

/// Name of the files looked for.
const RESULT_FILE: &str = "result.json";

/// Reads every `result.json` in `folder` and below, sorted by path. Links to folders are followed,
/// each folder is visited once. Hidden folders hold what is half-written or superseded, and no
/// results.
///
/// # Errors
/// When a folder cannot be listed, a result cannot be read (one broken result is an error: left
/// out, it would go unnoticed) or there is none.
pub fn collect(folder: &Path) -> Result<Vec<(PathBuf, ResultRecord)>, LeaderboardError> {
    let mut files = Vec::new();
    find(folder, &mut BTreeSet::new(), &mut files)?;
    files.sort();
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

fn find(
    folder: &Path,
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
            find(&path, visited, files)?;
        } else if path.file_name().is_some_and(|name| name == RESULT_FILE) {
            files.push(path);
        }
    }
    Ok(())
}

fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}
