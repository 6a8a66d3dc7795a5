//! JSON records, which carry their schema's name and version in `schema`. It is checked on reading.

use std::{io, path::Path};

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{StoreError, read_text, remove_abandoned, sha256_bytes, write_bytes};

/// JSON files with a published schema.
pub trait Record: Serialize + DeserializeOwned + schemars::JsonSchema {
    /// `omnilife/<name>/<version>`.
    const SCHEMA: &'static str;
    /// Older versions that are read as this one.
    const OLDER: &'static [&'static str] = &[];
}

#[derive(Serialize)]
struct TaggedRecord<'a, T> {
    schema: &'a str,
    #[serde(flatten)]
    record: &'a T,
}

#[derive(Deserialize)]
struct Tag {
    schema: Option<String>,
}

/// Returns the bytes of a record's file: pretty JSON with its schema first and a closing newline.
pub fn record_bytes<T: Record>(record: &T) -> Result<Vec<u8>, serde_json::Error> {
    let mut bytes = serde_json::to_vec_pretty(&TaggedRecord {
        schema: T::SCHEMA,
        record,
    })?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// Returns a record on one line without a line break, its schema first: for files of many records.
pub fn record_line<T: Record>(record: &T) -> Result<String, serde_json::Error> {
    serde_json::to_string(&TaggedRecord {
        schema: T::SCHEMA,
        record,
    })
}

/// Writes a record as JSON.
///
/// # Errors
/// When the file cannot be written, or when the record could not be read back. JSON has neither NaN nor infinity, so
/// a record that holds one is refused here instead of by its next reader. In an optional entry both become `null`,
/// which reads back as a missing value.
pub fn write_record<T: Record>(path: &Path, record: &T) -> Result<(), StoreError> {
    write_record_hashed(path, record).map(drop)
}

/// Writes a record as [`write_record`] does and returns the SHA-256 of the file.
///
/// # Errors
/// Those of [`write_record`].
pub fn write_record_hashed<T: Record>(path: &Path, record: &T) -> Result<String, StoreError> {
    let failed = |error: serde_json::Error| StoreError::write(path, io::Error::other(error));
    let bytes = record_bytes(record).map_err(failed)?;
    serde_json::from_slice::<T>(&bytes).map_err(failed)?;
    write_bytes(path, &bytes)?;
    Ok(sha256_bytes(&bytes))
}

/// Writes a record unless the file holds the same one already, and removes half-written files of killed processes
/// beside it.
///
/// # Errors
/// Those of [`write_record`]; an unreadable file is written anew.
pub fn update_record<T: Record + PartialEq>(path: &Path, record: &T) -> Result<(), StoreError> {
    let folder = path.parent().filter(|folder| folder.is_dir());
    folder.map_or(Ok(()), remove_abandoned)?;
    if read_record::<T>(path).is_ok_and(|held| held == *record) {
        return Ok(());
    }
    write_record(path, record)
}

/// Returns the schema that a JSON file names.
///
/// # Errors
/// When it cannot be read, is not JSON, or names no schema.
pub fn schema_of(path: &Path) -> Result<String, StoreError> {
    let text = read_text(path)?;
    tag(path, &text)?
        .ok_or_else(|| StoreError::malformed(path, "has no \"schema\" entry".to_owned()))
}

fn tag(path: &Path, text: &str) -> Result<Option<String>, StoreError> {
    serde_json::from_str(text)
        .map(|tag: Tag| tag.schema)
        .map_err(|error| {
            let fault = json_fault(text, &error);
            StoreError::malformed(path, format!("not a JSON record: {fault}"))
        })
}

/// Reads a record and checks that it has the requested schema.
pub fn read_record<T: Record>(path: &Path) -> Result<T, StoreError> {
    let text = read_text(path).map_err(|error| match error {
        StoreError::Read { source, .. } if source.kind() == io::ErrorKind::InvalidData => {
            StoreError::malformed(
                path,
                format!(
                    "must be a JSON record of schema {}, got a file that is not text",
                    T::SCHEMA
                ),
            )
        }
        error => error,
    })?;
    match tag(path, &text)?.as_deref() {
        Some(schema) if is_read_as::<T>(schema) => {}
        Some(schema) => {
            return Err(StoreError::malformed(
                path,
                format!("is of schema {schema}, expected {}", T::SCHEMA),
            ));
        }
        None => {
            return Err(StoreError::malformed(
                path,
                format!("has no \"schema\" entry, expected {}", T::SCHEMA),
            ));
        }
    }
    serde_json::from_str(&text)
        .map_err(|error| StoreError::malformed(path, format!("not a {}: {error}", T::SCHEMA)))
}

/// Returns the fault of a JSON text in words. Python and JavaScript write NaN and infinities as words, which JSON does
/// not have, and a parser only says that it expected a value there.
pub fn json_fault(text: &str, error: &serde_json::Error) -> String {
    let (line, column) = (error.line(), error.column());
    // Both count from 1, columns in bytes.
    let rest = (text.lines().nth(line.saturating_sub(1)))
        .and_then(|line| line.get(column.saturating_sub(1)..))
        .unwrap_or_default();
    let words = ["NaN", "Infinity"];
    match words.into_iter().find(|word| rest.starts_with(word)) {
        Some(word) => {
            format!("must hold finite numbers, got {word} at line {line} column {column}")
        }
        None => error.to_string(),
    }
}

/// Returns whether a file of this schema is read as a `T`.
pub fn is_read_as<T: Record>(schema: &str) -> bool {
    schema == T::SCHEMA || T::OLDER.contains(&schema)
}
