//! `times.csv`: when each exported frame was shown, which no foreign format says.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::store::{self, StoreError};
use serde::{Deserialize, Serialize};

use super::ExportFrame;

/// Name of the table in an exported folder.
pub(super) const TIMES_FILE: &str = "times.csv";

#[derive(Serialize, Deserialize)]
struct Row {
    image: String,
    time_seconds: f64,
}

/// Writes the table of an export.
pub(super) fn write(frames: &[ExportFrame], folder: &Path) -> Result<(), StoreError> {
    let rows = frames.iter().map(|frame| Row {
        image: frame.name.clone(),
        time_seconds: frame.time_seconds,
    });
    store::write_csv_rows(&folder.join(TIMES_FILE), rows)
}

/// Timestamps by image name, where the folder has the table.
///
/// # Errors
/// When the table is malformed.
pub(super) fn read(folder: &Path) -> Result<Option<BTreeMap<String, f64>>, StoreError> {
    let path = folder.join(TIMES_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let malformed = |error: csv::Error| StoreError::malformed(&path, error.to_string());
    let mut times = BTreeMap::new();
    for row in csv::Reader::from_path(&path)
        .map_err(malformed)?
        .deserialize()
    {
        let row: Row = row.map_err(malformed)?;
        if !row.time_seconds.is_finite()
            || times.insert(row.image.clone(), row.time_seconds).is_some()
        {
            return Err(StoreError::malformed(
                &path,
                format!("{} is there twice or has no finite time", row.image),
            ));
        }
    }
    Ok(Some(times))
}
