//! `SHA256SUMS`: a checksum of every file of a dataset, in the form of `sha256sum`.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use omnilife_schemas::{
    layout::{CHECKSUMS_FILE, PAGE_FILE, STATUS_FILE},
    progress::Progress,
    store::{self, StoreError},
};

use crate::error::CurateError;

/// Writes the checksums of all files of a dataset.
pub(super) fn write(folder: &Path, progress: &dyn Progress) -> Result<(), CurateError> {
    let files = files(folder)?;
    progress.begin("hashing the dataset", Some(files.len() as u64));
    let lines: Result<String, StoreError> = files
        .iter()
        .map(|file| {
            let sha256 = store::sha256_file(&folder.join(file))?;
            progress.advance(1);
            Ok(format!("{sha256}  {file}\n"))
        })
        .collect();
    progress.end();
    Ok(store::write_bytes(
        &folder.join(CHECKSUMS_FILE),
        lines?.as_bytes(),
    )?)
}

/// Reads the checksums: hash by file.
pub(super) fn read(folder: &Path) -> Result<BTreeMap<String, String>, StoreError> {
    let path = folder.join(CHECKSUMS_FILE);
    let text = fs::read_to_string(&path).map_err(|error| StoreError::read(&path, error))?;
    text.lines()
        .enumerate()
        .map(|(index, line)| {
            line.split_once("  ")
                .filter(|(hash, _)| hash.len() == 64)
                .map(|(hash, file)| (file.to_owned(), hash.to_owned()))
                .ok_or_else(|| {
                    StoreError::malformed(&path, format!("line {} must be a checksum", index + 1))
                })
        })
        .collect()
}

/// Returns true for an entry of a dataset's folder that a release leaves out: the page with its record, which names
/// commands of this machine, and hidden ones.
fn is_working_file(name: &str) -> bool {
    [PAGE_FILE, STATUS_FILE].contains(&name) || name.starts_with('.')
}

/// Returns the names of a dataset's entries that a release leaves out, at any depth, sorted.
pub(super) fn working_files(folder: &Path) -> Result<Vec<String>, StoreError> {
    let mut found = BTreeSet::new();
    let mut pending = vec![folder.to_owned()];
    while let Some(at) = pending.pop() {
        for path in store::paths_in(&at)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if store::is_hidden(&path) || (at == folder && is_working_file(&name)) {
                found.insert(name.into_owned());
            } else if path.is_dir() && !path.is_symlink() {
                pending.push(path);
            }
        }
    }
    Ok(found.into_iter().collect())
}

/// Returns all files of a dataset relative to it, with `/` between folders, sorted. Left out are hidden files (this
/// machine's records of finished stages), the checksums, and the page with its record, which is drawn anew at any time.
pub(super) fn files(folder: &Path) -> Result<Vec<String>, CurateError> {
    let mut found = Vec::new();
    let mut pending = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = pending.pop() {
        let failed = |error| StoreError::read(&path, error);
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let name = name.to_str().ok_or_else(|| {
                CurateError::input(
                    &entry.path(),
                    "its name is not UTF-8; a dataset cannot hold it",
                )
            })?;
            // `sha256sum` would escape them, and half of its readers do not support that.
            if name.contains(['\n', '\r', '\\']) {
                return Err(CurateError::input(
                    &entry.path(),
                    "its name has a line break or backslash; checksums cannot hold it",
                ));
            }
            let relative = format!("{prefix}{name}");
            if relative == CHECKSUMS_FILE || is_working_file(&relative) || name.starts_with('.') {
                continue;
            }
            if entry.file_type().map_err(failed)?.is_dir() {
                pending.push((entry.path(), format!("{relative}/")));
            } else {
                found.push(relative);
            }
        }
    }
    found.sort();
    Ok(found)
}
