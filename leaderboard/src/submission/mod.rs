//! Submissions of results.
//!
//! A submission is a folder: `submission.json` with the method's card and the hash of every file, and per result
//! `results/<n>/` with `result.json`, the table of its views and the predicted views themselves. [`pack`] makes one,
//! [`verify`] checks one without ground truth, [`add`] accepts one. With ground truth the caller can score the
//! predictions again: this crate reads no images.

mod add;
mod pack;
mod verify;

use std::{fs, path::Path};

use omnilife_schemas::{
    layout::{RESULT_FILE, SUBMISSION_FILE, VERIFICATION_FILE},
    records::SubmittedFile,
    store::{self, StoreError},
};

use crate::error::LeaderboardError;
use pack::submission_error;
pub(crate) use verify::check_means_of;

pub use add::add;
pub use pack::{PackRequest, pack, read_card};
pub use verify::{VerifiedSubmission, verify};

/// Returns all files below a folder, relative to it, sorted.
///
/// # Errors
/// When a folder cannot be listed, or holds a link or another special file: a submission must be self-contained.
fn files_below(folder: &Path) -> Result<Vec<String>, LeaderboardError> {
    let mut found = Vec::new();
    let mut folders = vec![(folder.to_owned(), String::new())];
    while let Some((next, prefix)) = folders.pop() {
        for name in store::names_in(&next)? {
            let path = next.join(&name);
            let relative = format!("{prefix}{name}");
            let kind = fs::symlink_metadata(&path)
                .map_err(|source| StoreError::read(&path, source))?
                .file_type();
            if kind.is_dir() {
                folders.push((path, format!("{relative}/")));
            } else if kind.is_file() {
                found.push(relative);
            } else {
                let what = if kind.is_symlink() {
                    "is a link; a submission holds the files themselves"
                } else {
                    "is a device, socket or pipe; a submission holds regular files"
                };
                return Err(submission_error(&path, what.to_owned()));
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Returns the size of a file in bytes.
fn size(folder: &Path, file: &str) -> Result<u64, StoreError> {
    let path = folder.join(file);
    let metadata = fs::metadata(&path).map_err(|source| StoreError::read(&path, source))?;
    Ok(metadata.len())
}

/// Describes a file in its present state.
fn described(folder: &Path, file: &str) -> Result<SubmittedFile, StoreError> {
    Ok(SubmittedFile {
        file: file.to_owned(),
        bytes: size(folder, file)?,
        sha256: store::sha256_file(&folder.join(file))?,
    })
}

/// Copies a file atomically, and creates its folder.
fn copy(from: &Path, to: &Path) -> Result<(), StoreError> {
    if let Some(folder) = to.parent() {
        store::create_folder(folder)?;
    }
    store::copy_atomically(from, to)
}
