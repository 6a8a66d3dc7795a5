//! Parquet for programs: the rows and columns of a CSV, with types.

use std::{io, path::Path};

use omnilife_schemas::store::StoreError;
use polars::prelude::{
    Column, DataFrame, NamedFrom, ParquetCompression, ParquetWriter, PlSmallStr, Series,
};

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Text,
    Count,
    Number,
}

/// The table of `csv`, whose first line names the columns; `kind` says what each holds. An empty
/// field is a missing value, and empty where it is text. `path` is named in errors.
///
/// The same CSV gives the same bytes.
pub(crate) fn of_csv(
    csv: &[u8],
    kind: impl Fn(&str) -> Kind,
    path: &Path,
) -> Result<Vec<u8>, StoreError> {
    let failed = |reason: String| StoreError::write(path, io::Error::other(reason));
    let mut reader = csv::Reader::from_reader(csv);
    let header = reader
        .headers()
        .map_err(|error| failed(error.to_string()))?
        .clone();
    let rows = reader
        .into_records()
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| failed(error.to_string()))?;
    let columns = header
        .iter()
        .enumerate()
        .map(|(index, name)| {
            let fields = rows.iter().map(|row| &row[index]);
            column(name, kind(name), fields)
                .ok_or_else(|| failed(format!("column {name} holds something else than numbers")))
        })
        .collect::<Result<Vec<Column>, _>>()?;
    let mut bytes = Vec::new();
    DataFrame::new(rows.len(), columns)
        .and_then(|mut table| {
            ParquetWriter::new(&mut bytes)
                .with_compression(ParquetCompression::Uncompressed)
                .finish(&mut table)
        })
        .map_err(|error| failed(error.to_string()))?;
    Ok(bytes)
}

/// `None` where a field is not of its kind.
fn column<'a>(name: &str, kind: Kind, fields: impl Iterator<Item = &'a str>) -> Option<Column> {
    let name = PlSmallStr::from(name);
    Some(
        match kind {
            Kind::Text => Series::new(name, fields.collect::<Vec<_>>()),
            Kind::Count => Series::new(name, parsed::<u64>(fields)?),
            Kind::Number => Series::new(name, parsed::<f64>(fields)?),
        }
        .into(),
    )
}

fn parsed<'a, T: std::str::FromStr>(
    fields: impl Iterator<Item = &'a str>,
) -> Option<Vec<Option<T>>> {
    fields
        .map(|field| match field {
            "" => Some(None),
            field => field.parse().ok().map(Some),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use polars::prelude::{ParquetReader, SerReader};

    use super::*;

    fn kind(name: &str) -> Kind {
        match name {
            "method" => Kind::Text,
            "failures" => Kind::Count,
            _ => Kind::Number,
        }
    }

    #[test]
    fn rows_come_back_with_their_types() -> Result<(), Box<dyn std::error::Error>> {
        let csv = b"method,failures,psnr\n\"a, b\",0,25.5\n,7,\n";
        let bytes = of_csv(csv, kind, Path::new("t.parquet"))?;
        assert_eq!(bytes, of_csv(csv, kind, Path::new("t.parquet"))?);
        let table = ParquetReader::new(io::Cursor::new(bytes)).finish()?;
        let text: Vec<Option<&str>> = table.column("method")?.str()?.iter().collect();
        assert_eq!(text, [Some("a, b"), Some("")]);
        let counts: Vec<Option<u64>> = table.column("failures")?.u64()?.iter().collect();
        assert_eq!(counts, [Some(0), Some(7)]);
        let numbers: Vec<Option<f64>> = table.column("psnr")?.f64()?.iter().collect();
        assert_eq!(numbers, [Some(25.5), None]);
        Ok(())
    }

    #[test]
    fn what_is_no_number_is_refused() {
        let error = of_csv(b"psnr\nbad\n", kind, Path::new("t.parquet")).map(drop);
        let message = error.expect_err("no number").to_string();
        assert!(message.contains("column psnr"), "{message}");
    }
}
