//! Text files of other programs, read up to a generous size limit.

use std::path::Path;

use omnilife_schemas::store::{self, StoreError};

/// Size of about a hundred thousand poses as JSON.
const MOST_BYTES: u64 = 1 << 26;

/// Reads the text of a file, without a byte order mark.
///
/// # Errors
/// When the file is missing, cannot be read, is larger than 64 MiB or is not UTF-8.
pub(super) fn read(path: &Path) -> Result<String, StoreError> {
    let bytes = store::read_limited(path, MOST_BYTES)?;
    let mut text = String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        StoreError::malformed(path, format!("is not UTF-8 at byte {place}"))
    })?;
    if text.starts_with('\u{feff}') {
        text.remove(0);
    }
    Ok(text)
}

/// Parses a JSON file of another program.
///
/// # Errors
/// Those of [`read`], or malformed content.
pub(super) fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, StoreError> {
    let text = read(path)?;
    serde_json::from_str(&text).map_err(|error| {
        let fault = store::json_fault(&text, &error);
        StoreError::malformed(path, format!("not what the format asks for: {fault}"))
    })
}
