//! Parquet tables: cells of a column, row by row.
//!
//! Rows that are read in their order are read once; a row before the last one begins its row group anew.

use std::{
    fs::File,
    path::{Path, PathBuf},
};

use omnilife_schemas::store::StoreError;
use parquet::{
    column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader},
    data_type::{ByteArray, DataType},
    errors::{ParquetError, Result as ParquetResult},
    file::reader::{FileReader, SerializedFileReader},
};

use crate::parquet_pages::{BoundedPages, ValuesLeft, reading};

/// Name of these tables in errors.
const WHAT: &str = "the Waymo Open Dataset";
/// Rows of a table at most.
const MOST_ROWS: usize = 1 << 22;
/// Values of a cell at most; a range image has about a million.
const MOST_VALUES: usize = 1 << 24;

/// A table of a segment.
pub(super) struct Table {
    path: PathBuf,
    reader: SerializedFileReader<File>,
    /// Number of rows.
    pub(super) rows: usize,
}

impl Table {
    /// Opens a table, which must be that of a single segment.
    ///
    /// # Errors
    /// When it cannot be read, is no Parquet table, or has rows of two segments.
    pub(super) fn open(path: PathBuf) -> Result<Self, StoreError> {
        let file = File::open(&path).map_err(|source| StoreError::read(&path, source))?;
        let reader = reading(&path, WHAT, || SerializedFileReader::new(file))?;
        let stated = reader.metadata().file_metadata().num_rows();
        let rows = usize::try_from(stated)
            .ok()
            .filter(|&rows| rows <= MOST_ROWS);
        let rows = rows.ok_or_else(|| {
            let reason = format!("must hold up to {MOST_ROWS} rows, states {stated}");
            StoreError::malformed(&path, reason)
        })?;
        let table = Self { path, reader, rows };
        let mut segments = table.column("key.segment_context_name")?;
        let first = if rows > 0 {
            segments.text(0)?
        } else {
            String::new()
        };
        for row in 1..rows {
            let other = segments.text(row)?;
            if other != first {
                let reason = format!("must be of one segment, got {first} and {other}");
                return Err(table.fault(row, reason));
            }
        }
        Ok(table)
    }

    /// Returns the path of its file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns an error of a row, counted from 0.
    pub(super) fn fault(&self, row: usize, reason: impl AsRef<str>) -> StoreError {
        StoreError::malformed(&self.path, format!("row {row}: {}", reason.as_ref()))
    }

    /// Returns true if it has this column.
    pub(super) fn has(&self, name: &str) -> bool {
        self.leaf(name).is_some()
    }

    fn leaf(&self, name: &str) -> Option<usize> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let mut columns = schema.columns().iter();
        columns.position(|column| {
            column
                .path()
                .parts()
                .first()
                .is_some_and(|first| first == name)
        })
    }

    /// Opens a column; a column of lists by its own name.
    ///
    /// # Errors
    /// When the table has none of this name.
    pub(super) fn column(&self, name: &str) -> Result<Column<'_>, StoreError> {
        let leaf = self.leaf(name).ok_or_else(|| {
            StoreError::malformed(&self.path, format!("must hold the column {name}"))
        })?;
        Ok(Column {
            table: self,
            name: name.to_owned(),
            leaf,
            left: ValuesLeft::new(MOST_VALUES),
            group: None,
        })
    }
}

/// Values of a cell; none where it is empty.
enum Cell {
    Integers(Vec<i64>),
    Numbers(Vec<f64>),
    Bytes(Vec<ByteArray>),
}

/// A column that is being read.
pub(super) struct Column<'a> {
    table: &'a Table,
    name: String,
    leaf: usize,
    left: ValuesLeft,
    group: Option<Group>,
}

/// A row group that is being read.
struct Group {
    rows: std::ops::Range<usize>,
    next: usize,
    reader: ColumnReader,
}

impl Column<'_> {
    /// Returns an integer.
    ///
    /// # Errors
    /// When the cell is of another kind or empty.
    pub(super) fn integer(&mut self, row: usize) -> Result<i64, StoreError> {
        match self.cell(row)? {
            Cell::Integers(values) => self.one(row, values),
            _ => Err(self.fault(row, "an integer")),
        }
    }

    /// Returns a finite number.
    ///
    /// # Errors
    /// When the cell is of another kind, empty, or not finite.
    pub(super) fn number(&mut self, row: usize) -> Result<f64, StoreError> {
        let [value] = self.exactly(row)?;
        Ok(value)
    }

    /// Returns a list of `N` finite numbers.
    ///
    /// # Errors
    /// When the cell is of another kind or length, or a number is not finite.
    pub(super) fn exactly<const N: usize>(&mut self, row: usize) -> Result<[f64; N], StoreError> {
        let found = self.numbers(row)?;
        let are_finite = found.iter().all(|value| value.is_finite());
        let values = <[f64; N]>::try_from(found).ok().filter(|_| are_finite);
        values.ok_or_else(|| self.fault(row, &format!("{N} finite numbers")))
    }

    /// Returns a list of numbers, empty in an empty cell.
    ///
    /// # Errors
    /// When the cell is of another kind.
    pub(super) fn numbers(&mut self, row: usize) -> Result<Vec<f64>, StoreError> {
        match self.cell(row)? {
            Cell::Numbers(values) => Ok(values),
            Cell::Integers(values) => Ok(values.into_iter().map(|value| value as f64).collect()),
            Cell::Bytes(values) if values.is_empty() => Ok(Vec::new()),
            Cell::Bytes(_) => Err(self.fault(row, "numbers")),
        }
    }

    /// Returns a text.
    ///
    /// # Errors
    /// When the cell is of another kind, empty or not UTF-8.
    pub(super) fn text(&mut self, row: usize) -> Result<String, StoreError> {
        let bytes = self.bytes(row)?;
        let text = std::str::from_utf8(bytes.data()).ok().map(str::to_owned);
        text.ok_or_else(|| self.fault(row, "a UTF-8 text"))
    }

    /// Returns bytes.
    ///
    /// # Errors
    /// When the cell is of another kind or empty.
    pub(super) fn bytes(&mut self, row: usize) -> Result<ByteArray, StoreError> {
        match self.cell(row)? {
            Cell::Bytes(values) => self.one(row, values),
            _ => Err(self.fault(row, "bytes")),
        }
    }

    fn one<T>(&self, row: usize, values: Vec<T>) -> Result<T, StoreError> {
        let [value] = <[T; 1]>::try_from(values).map_err(|_| self.fault(row, "one value"))?;
        Ok(value)
    }

    fn fault(&self, row: usize, must_hold: &str) -> StoreError {
        let reason = format!("must hold {must_hold} in {}", self.name);
        self.table.fault(row, reason)
    }

    fn cell(&mut self, row: usize) -> Result<Cell, StoreError> {
        let path = &self.table.path;
        let is_ahead = |group: &Group| group.rows.contains(&row) && group.next <= row;
        let open = self.group.take().filter(is_ahead);
        let read = || {
            let mut group = match open {
                Some(group) => group,
                None => self.opened(row)?,
            };
            let skipped = row.saturating_sub(group.next);
            let next = Next {
                left: &self.left,
                skipped,
            };
            let cell = match &mut group.reader {
                ColumnReader::Int32ColumnReader(column) => {
                    Cell::Integers(next.cell(column)?.into_iter().map(i64::from).collect())
                }
                ColumnReader::Int64ColumnReader(column) => Cell::Integers(next.cell(column)?),
                ColumnReader::FloatColumnReader(column) => {
                    Cell::Numbers(next.cell(column)?.into_iter().map(f64::from).collect())
                }
                ColumnReader::DoubleColumnReader(column) => Cell::Numbers(next.cell(column)?),
                ColumnReader::ByteArrayColumnReader(column) => Cell::Bytes(next.cell(column)?),
                _ => {
                    let reason = format!("column {} has a type that is not read", self.name);
                    return Err(ParquetError::General(reason));
                }
            };
            group.next = row.saturating_add(1);
            Ok((cell, group))
        };
        let (cell, group) = reading(path, WHAT, read)?;
        self.group = Some(group);
        Ok(cell)
    }

    /// Opens the row group of a row.
    fn opened(&self, row: usize) -> ParquetResult<Group> {
        let reader = &self.table.reader;
        let mut begin = 0_usize;
        for number in 0..reader.num_row_groups() {
            let group = reader.get_row_group(number)?;
            let count = usize::try_from(group.metadata().num_rows()).unwrap_or_default();
            let end = begin.saturating_add(count);
            if !(begin..end).contains(&row) {
                begin = end;
                continue;
            }
            let pages =
                BoundedPages::new(group.get_column_page_reader(self.leaf)?, self.left.clone());
            let column = group.metadata().column(self.leaf).column_descr_ptr();
            return Ok(Group {
                rows: begin..end,
                next: begin,
                reader: get_column_reader(column, Box::new(pages)),
            });
        }
        Err(ParquetError::General(format!(
            "row {row} is in no row group"
        )))
    }
}

/// The next row to be read of a column.
struct Next<'a> {
    left: &'a ValuesLeft,
    /// Rows before it.
    skipped: usize,
}

impl Next<'_> {
    /// Reads the values of a cell.
    fn cell<T: DataType>(&self, column: &mut ColumnReaderImpl<T>) -> ParquetResult<Vec<T::T>> {
        self.left.set(usize::MAX);
        column.skip_records(self.skipped)?;
        self.left.set(MOST_VALUES);
        let (mut present, mut places, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let (rows, _, levels) =
            column.read_records(1, Some(&mut present), Some(&mut places), &mut values)?;
        let fault = |reason: &str| Err(ParquetError::General(reason.to_owned()));
        if rows != 1 {
            return fault("a column ends before its table");
        }
        if !values.is_empty() && values.len() != levels {
            return fault("a list has empty values");
        }
        Ok(values)
    }
}
