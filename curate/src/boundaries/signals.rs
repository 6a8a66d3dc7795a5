//! The per-frame table that a detector's pass leaves, and its Parquet file.

use std::{fs::File, path::Path};

use omnilife_schemas::store;
use polars::prelude::{
    Column, DataFrame, NamedFrom, ParquetReader, ParquetWriter, SerReader, Series,
};

use crate::error::CurateError;

/// Name of the column of timestamps.
const TIME: &str = "time_seconds";

/// Named per-frame signals with their timestamps, in order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// Presentation timestamps, seconds.
    pub times: Vec<f64>,
    /// Signals by name, each as long as `times`.
    pub columns: Vec<(String, Vec<f32>)>,
}

/// A table lacks a signal that a detector decides by: another detector left it, or the file was
/// changed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the signals have no column {name} with one value per frame")]
pub struct MissingSignal {
    /// Name of the column.
    pub name: String,
}

impl Signals {
    /// The signal with this name, one value per frame.
    ///
    /// # Errors
    /// [`MissingSignal`] where there is none.
    pub fn column(&self, name: &str) -> Result<&[f32], MissingSignal> {
        self.columns
            .iter()
            .find(|(other, values)| other == name && values.len() == self.times.len())
            .map(|(_, values)| values.as_slice())
            .ok_or_else(|| MissingSignal {
                name: name.to_owned(),
            })
    }

    /// Writes the table, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<(), CurateError> {
        let mut columns = vec![Column::from(Series::new(TIME.into(), &self.times))];
        for (name, values) in &self.columns {
            columns.push(Column::from(Series::new(name.as_str().into(), values)));
        }
        let mut frame = DataFrame::new(self.times.len(), columns)
            .map_err(|error| CurateError::internal(path, error))?;
        let mut bytes = Vec::new();
        ParquetWriter::new(&mut bytes)
            .finish(&mut frame)
            .map_err(|error| CurateError::internal(path, error))?;
        Ok(store::write_bytes(path, &bytes)?)
    }

    /// Reads a table that [`Signals::write_parquet`] wrote.
    ///
    /// # Errors
    /// When the file is missing or not such a table.
    pub fn read_parquet(path: &Path) -> Result<Self, CurateError> {
        omnilife_schemas::error_kind::reading(path);
        let malformed =
            |reason: String| CurateError::Store(store::StoreError::malformed(path, reason));
        let file = File::open(path).map_err(|source| store::StoreError::read(path, source))?;
        let frame = ParquetReader::new(file)
            .finish()
            .map_err(|error| malformed(format!("not a Parquet table: {error}")))?;
        let mut signals = Self::default();
        for column in frame.columns() {
            let name = column.name().as_str();
            if name == TIME {
                let times = column.f64().map_err(|error| malformed(error.to_string()))?;
                signals.times = times.into_no_null_iter().collect();
            } else {
                let values = column.f32().map_err(|error| malformed(error.to_string()))?;
                signals
                    .columns
                    .push((name.to_owned(), values.into_no_null_iter().collect()));
            }
        }
        if signals.times.is_empty() {
            return Err(malformed(format!("has no rows in a column {TIME}")));
        }
        Ok(signals)
    }
}
