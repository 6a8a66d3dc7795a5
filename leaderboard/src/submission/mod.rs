//! Results that others hand in.
//!
//! A submission is a folder: `submission.json` with the method's card and the hash of every file,
//! and per result `results/<n>/` with `result.json`, the table of its views and the predicted views
//! themselves. [`pack`] makes one, [`verify`] checks one without ground truth, [`add`] takes one in.
//! With ground truth the predictions can be scored again, which is the caller's: this crate reads
//! no images.

mod add;
mod pack;
mod verify;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::RESULT_FILE,
    records::SubmittedFile,
    store::{self, StoreError},
};

pub use add::add;
pub use pack::{PackRequest, pack};
pub use verify::{Verified, verify};

/// Name of the record in a submission's folder.
pub const SUBMISSION_FILE: &str = "submission.json";

/// All files below a folder, relative to it, sorted.
fn files_below(folder: &Path) -> Result<Vec<String>, StoreError> {
    let mut found = Vec::new();
    let mut folders = vec![(folder.to_owned(), String::new())];
    while let Some((next, prefix)) = folders.pop() {
        for name in store::names_in(&next)? {
            let path = next.join(&name);
            let relative = format!("{prefix}{name}");
            if path.is_dir() {
                folders.push((path, format!("{relative}/")));
            } else {
                found.push(relative);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// A file as it is now.
fn described(folder: &Path, file: &str) -> Result<SubmittedFile, StoreError> {
    let path: PathBuf = folder.join(file);
    let metadata = std::fs::metadata(&path).map_err(|source| StoreError::read(&path, source))?;
    Ok(SubmittedFile {
        file: file.to_owned(),
        bytes: metadata.len(),
        sha256: store::sha256_file(&path)?,
    })
}

/// Copies a file whole or not at all, and makes its folder.
fn copy(from: &Path, to: &Path) -> Result<(), StoreError> {
    if let Some(folder) = to.parent() {
        store::create_folder(folder)?;
    }
    let mut source = std::fs::File::open(from).map_err(|error| StoreError::read(from, error))?;
    store::write_with(to, |writer| std::io::copy(&mut source, writer).map(drop))
}
