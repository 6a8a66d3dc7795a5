//! Tables as Parquet files. The same rows give the same bytes.

use std::sync::Arc;

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as PhysicalType, ZstdLevel},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        properties::WriterProperties,
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::Type,
};

use crate::{
    columns::{Column, Getter, Table},
    error::ResultsError,
    query::{AnswerColumn, Values},
    rows::{Loaded, Row},
    source::Source,
};

/// Number of results per row group.
const CHUNK: usize = 1024;

/// A table as a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableFile {
    /// Content of the file; `None` without rows.
    pub bytes: Option<Vec<u8>>,
    /// Number of results without the table's source file.
    pub without: usize,
}

/// Writes a table of results in their order.
///
/// # Errors
/// [`ResultsError::Store`] and [`ResultsError::Impossible`] for files beside results.
pub fn write(table: &Table, sources: &[Source<'_>]) -> Result<TableFile, ResultsError> {
    let columns: Vec<&Column> = table.columns().collect();
    let fields = columns.iter().map(|column| {
        let kind = match column.values {
            Getter::Text(_) => Kind::Text,
            Getter::Number(_) => Kind::Number,
            Getter::Count(_) => Kind::Count,
            Getter::Flag(_) => Kind::Flag,
        };
        field(column.name, kind)
    });
    let mut writer = writer(table.name, fields)?;
    let (mut without, mut has_rows) = (0, false);
    for chunk in sources.chunks(CHUNK) {
        let loaded: Vec<Loaded<'_>> = chunk
            .iter()
            .map(|source| Loaded::read(source, table.beside))
            .collect::<Result<_, _>>()?;
        without += loaded
            .iter()
            .filter(|loaded| !loaded.has(table.beside))
            .count();
        let mut rows: Vec<Row<'_>> = Vec::new();
        for result in &loaded {
            (table.rows)(result, &mut |row| rows.push(row));
        }
        if rows.is_empty() {
            continue;
        }
        has_rows = true;
        let mut group = writer.next_row_group()?;
        for column in &columns {
            write_rows(&mut group, column, &rows)?;
        }
        group.close()?;
    }
    Ok(TableFile {
        bytes: has_rows.then(|| writer.into_inner()).transpose()?,
        without,
    })
}

/// Writes an answer.
///
/// # Errors
/// [`ResultsError::Table`] when the library fails.
pub(crate) fn of_answer(columns: &[AnswerColumn]) -> Result<Vec<u8>, ResultsError> {
    let fields = columns.iter().map(|column| {
        let kind = match column.values {
            Values::Text(_) => Kind::Text,
            Values::Number(_) => Kind::Number,
            Values::Count(_) => Kind::Count,
            Values::Flag(_) => Kind::Flag,
        };
        field(&column.name, kind)
    });
    let mut writer = writer("answer", fields)?;
    let mut group = writer.next_row_group()?;
    for column in columns {
        match &column.values {
            Values::Text(values) => {
                let texts = values
                    .iter()
                    .map(|text| text.as_deref().map(ByteArray::from));
                write_column::<ByteArrayType>(&mut group, texts)?;
            }
            Values::Number(values) => {
                write_column::<DoubleType>(&mut group, values.iter().copied())?;
            }
            Values::Count(values) => {
                write_column::<Int64Type>(&mut group, values.iter().copied())?;
            }
            Values::Flag(values) => write_column::<BoolType>(&mut group, values.iter().copied())?,
        }
    }
    group.close()?;
    Ok(writer.into_inner()?)
}

#[derive(Clone, Copy)]
enum Kind {
    Text,
    Number,
    Count,
    Flag,
}

fn field(name: &str, kind: Kind) -> Result<Arc<Type>, ParquetError> {
    let (physical, logical) = match kind {
        Kind::Text => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
        Kind::Number => (PhysicalType::DOUBLE, None),
        Kind::Count => (PhysicalType::INT64, None),
        Kind::Flag => (PhysicalType::BOOLEAN, None),
    };
    let field = Type::primitive_type_builder(name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical)
        .build()?;
    Ok(Arc::new(field))
}

fn writer(
    name: &str,
    fields: impl Iterator<Item = Result<Arc<Type>, ParquetError>>,
) -> Result<SerializedFileWriter<Vec<u8>>, ParquetError> {
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    let schema = Type::group_type_builder(name).with_fields(fields).build()?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .build();
    SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))
}

fn write_rows(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    column: &Column,
    rows: &[Row<'_>],
) -> Result<(), ParquetError> {
    let rows = rows.iter();
    match column.values {
        Getter::Text(get) => {
            write_column::<ByteArrayType>(group, rows.map(|row| get(row).map(ByteArray::from)))
        }
        Getter::Number(get) => write_column::<DoubleType>(group, rows.map(get)),
        Getter::Count(get) => write_column::<Int64Type>(group, rows.map(get)),
        Getter::Flag(get) => write_column::<BoolType>(group, rows.map(|row| Some(get(row)))),
    }
}

/// Writes the next column, empty for values that are `None`.
fn write_column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    values: impl Iterator<Item = Option<T::T>>,
) -> Result<(), ParquetError> {
    let mut present = Vec::new();
    let mut levels = Vec::new();
    for value in values {
        levels.push(i16::from(value.is_some()));
        present.extend(value);
    }
    let Some(mut column) = group.next_column()? else {
        return Err(ParquetError::General("a column too many".to_owned()));
    };
    column
        .typed::<T>()
        .write_batch(&present, Some(&levels), None)?;
    column.close()
}
