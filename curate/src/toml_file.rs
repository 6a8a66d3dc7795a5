//! Configuration files in TOML.

use std::{fs, path::Path};

use omnilife_schemas::store::StoreError;
use serde::de::DeserializeOwned;

use crate::error::CurateError;

/// Reads a TOML file.
///
/// # Errors
/// When it cannot be read or is malformed, with the line.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, CurateError> {
    let text = fs::read_to_string(path).map_err(|error| StoreError::read(path, error))?;
    toml::from_str(&text).map_err(|error| {
        let begin = error.span().and_then(|span| text.get(..span.start));
        let line = begin.map_or(1, |begin| begin.matches('\n').count().saturating_add(1));
        // Only the first line gives the reason.
        let reason = error.message().lines().next().unwrap_or_default();
        CurateError::input(path, format!("line {line}: {reason}"))
    })
}
