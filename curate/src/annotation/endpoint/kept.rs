//! Answers that are kept, so that nothing is asked for twice.
//!
//! They lie in the hidden folder [`FOLDER`] of the dataset, one record per question. The name is the
//! hash of the question: other images, another prompt, model or endpoint is another question.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    records::CaptionAnswer,
    store::{self, StoreError},
};

use super::Endpoint;

/// Relative to the dataset.
const FOLDER: &str = ".captions";

/// Where the answer to a question is kept.
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
