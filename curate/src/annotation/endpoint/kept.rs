//! Cache of answers, so that no request is sent twice.
//!
//! Answers lie in the hidden folder [`FOLDER`] of the dataset, one record per request, named by the request's hash.
//! Other images, another prompt, model or endpoint make another request.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    records::CaptionAnswer,
    store::{self, StoreError},
};

use super::Endpoint;

/// Relative to the dataset.
const FOLDER: &str = ".captions";

/// Returns the file of the answer to a request.
pub(super) fn file(
    dataset: &Path,
    endpoint: &Endpoint,
    model: &str,
    prompt: &str,
    images: &[String],
) -> PathBuf {
    let mut question = format!("{endpoint}\n{model}\n{prompt}\n");
    for image in images {
        question += &store::sha256_bytes(image.as_bytes());
    }
    let hash = store::sha256_bytes(question.as_bytes());
    dataset.join(FOLDER).join(format!("{hash}.json"))
}

pub(super) fn read(file: &Path) -> Result<Option<CaptionAnswer>, StoreError> {
    if !file.is_file() {
        return Ok(None);
    }
    store::read_record(file).map(Some)
}

pub(super) fn write(file: &Path, answer: &CaptionAnswer) -> Result<(), StoreError> {
    if let Some(folder) = file.parent() {
        store::create_folder(folder)?;
    }
    store::write_record(file, answer)
}
