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
/// each folder is visited once.
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
    let mut paths = fs::read_dir(folder)
        .map_err(failed)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    // The order decides which of two links to one folder gives the path, so it must be fixed.
    paths.sort();
    for path in paths {
        if path.is_dir() {
            find(&path, visited, files)?;
        } else if path.file_name().is_some_and(|name| name == RESULT_FILE) {
            files.push(path);
        }
    }
    Ok(())
}
