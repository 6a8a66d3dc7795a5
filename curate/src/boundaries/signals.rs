//! The per-frame table that a detector's pass leaves, and its Parquet file.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs::File, path::Path, sync::Arc};

use omnilife_schemas::store;
use parquet::{
    basic::{Compression, Repetition, Type as PhysicalType, ZstdLevel},
    column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader},
    data_type::{DataType, DoubleType, FloatType},
    errors::ParquetError,
    file::{
        metadata::ParquetMetaData,
        properties::WriterProperties,
        reader::{FileReader, SerializedFileReader},
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::Type,
};

use crate::{
    error::CurateError,
    parquet_pages::{self, BoundedPages, ValuesLeft},
};

/// Name of the column of timestamps.
const TIME: &str = "time_seconds";
/// Rows of a table at most: 25 days of 30 frames a second.
const MOST_ROWS: i64 = 1 << 26;
/// Bytes of a column at most: as many rows of f64.
const MOST_BYTES: i64 = 8 * MOST_ROWS;

/// Named per-frame signals with their timestamps, in order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// Presentation timestamps, seconds.
    pub times: Vec<f64>,
    /// Signals by name, each as long as `times`.
    pub columns: Vec<(String, Vec<f32>)>,
}

/// Error: a table lacks a signal that a detector needs, because another detector left it or the file was changed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the signals have no column {name} with one value per frame")]
pub struct MissingSignal {
    /// Name of the column.
    pub name: String,
}

impl Signals {
    /// Returns the signal with this name, one value per frame.
    ///
    /// # Errors
    /// [`MissingSignal`] if the table lacks it.
    pub fn column(&self, name: &str) -> Result<&[f32], MissingSignal> {
        self.columns
            .iter()
            .find(|(other, values)| other == name && values.len() == self.times.len())
            .map(|(_, values)| values.as_slice())
            .ok_or_else(|| MissingSignal {
                name: name.to_owned(),
            })
    }

    /// Writes the table atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<(), CurateError> {
        let bytes = (self.to_parquet()).map_err(|error| CurateError::internal(path, error))?;
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
        let signals = parquet_pages::reading(path, "signals", || Self::of_parquet(file))?;
        if signals.times.is_empty() {
            return Err(malformed(format!("has no rows in a column {TIME}")));
        }
        Ok(signals)
    }

    fn to_parquet(&self) -> Result<Vec<u8>, ParquetError> {
        let column = |name: &str, kind: PhysicalType| {
            let column = Type::primitive_type_builder(name, kind);
            let column = column.with_repetition(Repetition::REQUIRED).build()?;
            Ok(Arc::new(column))
        };
        let times = [column(TIME, PhysicalType::DOUBLE)].into_iter();
        let signals = self
            .columns
            .iter()
            .map(|(name, _)| column(name, PhysicalType::FLOAT));
        let columns = times.chain(signals).collect::<Result<_, ParquetError>>()?;
        let schema = Type::group_type_builder("signals").with_fields(columns);
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .build();
        let (schema, properties) = (Arc::new(schema.build()?), Arc::new(properties));
        let mut writer = SerializedFileWriter::new(Vec::new(), schema, properties)?;
        let mut rows = writer.next_row_group()?;
        write_column::<DoubleType>(&mut rows, &self.times)?;
        for (_, values) in &self.columns {
            write_column::<FloatType>(&mut rows, values)?;
        }
        rows.close()?;
        writer.into_inner()
    }

    fn of_parquet(file: File) -> Result<Self, ParquetError> {
        let reader = SerializedFileReader::new(file)?;
        refuse_impossible_sizes(reader.metadata())?;
        let mut signals = Self::default();
        for group in 0..reader.num_row_groups() {
            let rows = reader.get_row_group(group)?;
            let count = usize::try_from(rows.metadata().num_rows())
                .map_err(|error| ParquetError::General(error.to_string()))?;
            for (at, column) in rows.metadata().columns().iter().enumerate() {
                let name = column.column_path().string();
                let pages = BoundedPages::new(
                    rows.get_column_page_reader(at)?,
                    ValuesLeft::new(MOST_ROWS as usize),
                );
                match get_column_reader(column.column_descr_ptr(), Box::new(pages)) {
                    ColumnReader::DoubleColumnReader(column) if name == TIME => {
                        read_column(column, count, &mut signals.times)?;
                    }
                    ColumnReader::FloatColumnReader(column) if name != TIME => {
                        read_column(column, count, signals.column_mut(&name))?;
                    }
                    _ => {
                        let reason = format!("column {name} holds no such numbers");
                        return Err(ParquetError::General(reason));
                    }
                }
            }
        }
        Ok(signals)
    }

    /// Values of a signal, initially empty.
    #[expect(
        clippy::indexing_slicing,
        reason = "the column was found, or was just added"
    )]
    fn column_mut(&mut self, name: &str) -> &mut Vec<f32> {
        let known = self.columns.iter().position(|(other, _)| other == name);
        let at = known.unwrap_or(self.columns.len());
        if at == self.columns.len() {
            self.columns.push((name.to_owned(), Vec::new()));
        }
        &mut self.columns[at].1
    }
}

/// Refuses a file by whose numbers a reader would allocate more than signals can take.
fn refuse_impossible_sizes(metadata: &ParquetMetaData) -> Result<(), ParquetError> {
    let mut sizes = vec![(metadata.file_metadata().num_rows(), MOST_ROWS)];
    for group in metadata.row_groups() {
        sizes.push((group.num_rows(), MOST_ROWS));
        for column in group.columns() {
            sizes.push((column.num_values(), MOST_ROWS));
            sizes.push((column.compressed_size(), MOST_BYTES));
            sizes.push((column.uncompressed_size(), MOST_BYTES));
        }
    }
    match sizes
        .iter()
        .find(|(size, most)| !(0..=*most).contains(size))
    {
        None => Ok(()),
        Some((size, most)) => Err(ParquetError::General(format!(
            "states {size}, and 0 to {most} is possible there"
        ))),
    }
}

fn write_column<T: DataType>(
    rows: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    values: &[T::T],
) -> Result<(), ParquetError> {
    let Some(mut column) = rows.next_column()? else {
        return Err(ParquetError::General("a column too many".to_owned()));
    };
    column.typed::<T>().write_batch(values, None, None)?;
    column.close()
}

/// Appends up to `count` values of a column, fewer if some rows have none.
fn read_column<T: DataType>(
    mut column: ColumnReaderImpl<T>,
    count: usize,
    values: &mut Vec<T::T>,
) -> Result<(), ParquetError> {
    let mut present = Vec::new();
    column.read_records(count, Some(&mut present), None, values)?;
    Ok(())
}
