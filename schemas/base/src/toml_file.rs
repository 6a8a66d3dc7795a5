//! Configuration files in TOML.

use std::{fs, path::Path};

use serde::de::DeserializeOwned;

use crate::store::StoreError;

/// Reads a TOML file.
///
/// # Errors
/// When it cannot be read or is malformed, with the line.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, StoreError> {
    let text = fs::read_to_string(path).map_err(|error| StoreError::read(path, error))?;
    toml::from_str(&text).map_err(|error| {
        let begin = error.span().and_then(|span| text.get(..span.start));
        let line = begin.map_or(1, |begin| begin.matches('\n').count().saturating_add(1));
        // Only the first line gives the reason.
        let reason = error.message().lines().next().unwrap_or_default();
        StoreError::malformed(path, format!("line {line}: {reason}"))
    })
}
