//! Answers as a table of text, CSV, JSON or Parquet.

use omnilife_schemas::plain_text::{for_spreadsheet, for_terminal};

use crate::{
    error::ResultsError,
    parquet_file,
    query::{Answer, AnswerColumn, Values},
};

/// A format of answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerFormat {
    /// A table for people; columns with a single value become a line above it.
    Table,
    /// Comma-separated values with a header.
    Csv,
    /// A list of objects, one per row.
    Json,
    /// A Parquet file.
    Parquet,
}

/// Columns that appear above a table if all rows have one value.
const CAPTION: [&str; 5] = ["protocol", "protocol_hash", "view", "region", "of_scenes"];
/// Digits of a hash in a table for people.
const HASH_DIGITS: usize = 12;
/// Digits of numbers in a table for people.
const DIGITS: usize = 3;

/// Renders an answer.
///
/// # Errors
/// [`ResultsError::Table`] when a library fails.
pub fn render(answer: &Answer, format: AnswerFormat) -> Result<Vec<u8>, ResultsError> {
    match format {
        AnswerFormat::Table => Ok(table(answer).into_bytes()),
        AnswerFormat::Csv => csv(answer),
        AnswerFormat::Json => json(answer),
        AnswerFormat::Parquet => parquet_file::of_answer(&answer.columns),
    }
}

fn csv(answer: &Answer) -> Result<Vec<u8>, ResultsError> {
    let failed = |error: &dyn std::fmt::Display| ResultsError::Table(error.to_string());
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = answer.columns.iter().map(|column| &column.name);
    writer.write_record(names).map_err(|error| failed(&error))?;
    for row in 0..answer.height() {
        let cells = answer.columns.iter().map(|column| match &column.values {
            Values::Text(_) => for_spreadsheet(&column.cell(row, None)).into_owned(),
            _ => column.cell(row, None),
        });
        writer.write_record(cells).map_err(|error| failed(&error))?;
    }
    writer.into_inner().map_err(|error| failed(&error))
}

fn json(answer: &Answer) -> Result<Vec<u8>, ResultsError> {
    let rows: Vec<serde_json::Map<String, serde_json::Value>> = (0..answer.height())
        .map(|row| {
            let cells = answer.columns.iter();
            cells
                .map(|column| (column.name.clone(), column.json(row)))
                .collect()
        })
        .collect();
    let mut bytes =
        serde_json::to_vec_pretty(&rows).map_err(|error| ResultsError::Table(error.to_string()))?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// Returns a Markdown table, its columns aligned.
fn table(answer: &Answer) -> String {
    let (caption, columns): (Vec<&AnswerColumn>, Vec<&AnswerColumn>) = answer
        .columns
        .iter()
        .partition(|column| CAPTION.contains(&column.name.as_str()) && column.is_constant());
    let facts: Vec<String> = caption
        .iter()
        .map(|column| format!("{} {}", column.name, column.shown(0)))
        .collect();
    let cells: Vec<Vec<String>> = columns
        .iter()
        .map(|column| {
            let rows = (0..answer.height()).map(|row| {
                let cell = column.shown(row);
                for_terminal(&cell).replace('|', "\\|").replace('\n', " ")
            });
            std::iter::once(column.name.clone()).chain(rows).collect()
        })
        .collect();
    let widths: Vec<usize> = cells
        .iter()
        .map(|column| column.iter().map(|cell| cell.chars().count()).max())
        .map(|width| width.unwrap_or(0).max(3))
        .collect();
    let mut text = String::new();
    if !facts.is_empty() {
        text.push_str(&format!("{}\n\n", facts.join(", ")));
    }
    for row in 0..=answer.height() {
        let line: Vec<String> = (columns.iter().zip(&cells).zip(&widths))
            .map(|((column, cells), &width)| match column.values {
                Values::Text(_) | Values::Flag(_) => format!("{:<width$}", cells[row]),
                Values::Number(_) | Values::Count(_) => format!("{:>width$}", cells[row]),
            })
            .collect();
        text.push_str(&format!("| {} |\n", line.join(" | ")));
        if row == 0 {
            let rules = columns.iter().zip(&widths);
            let rules: Vec<String> = rules
                .map(|(column, &width)| match column.values {
                    Values::Text(_) | Values::Flag(_) => "-".repeat(width),
                    Values::Number(_) | Values::Count(_) => format!("{}:", "-".repeat(width - 1)),
                })
                .collect();
            text.push_str(&format!("| {} |\n", rules.join(" | ")));
        }
    }
    text
}

impl AnswerColumn {
    /// Returns the text of a value in a table for people: hashes by their first digits.
    fn shown(&self, row: usize) -> String {
        let cell = self.cell(row, Some(DIGITS));
        match self.name.as_str() {
            "protocol_hash" => format!("{}…", cell.chars().take(HASH_DIGITS).collect::<String>()),
            _ => cell,
        }
    }

    /// Returns the text of a value, empty without one.
    fn cell(&self, row: usize, digits: Option<usize>) -> String {
        match &self.values {
            Values::Text(values) => values[row].clone().unwrap_or_default(),
            Values::Number(values) => values[row].map_or_else(String::new, |value| match digits {
                Some(digits) => format!("{value:.digits$}"),
                None => value.to_string(),
            }),
            Values::Count(values) => {
                values[row].map_or_else(String::new, |value| value.to_string())
            }
            Values::Flag(values) => values[row].map_or_else(String::new, |value| value.to_string()),
        }
    }

    /// Returns a JSON value. JSON has no infinite numbers: they are texts, `inf`.
    fn json(&self, row: usize) -> serde_json::Value {
        match &self.values {
            Values::Text(values) => values[row].clone().into(),
            Values::Number(values) => match values[row] {
                Some(value) if !value.is_finite() => value.to_string().into(),
                value => value.into(),
            },
            Values::Count(values) => values[row].into(),
            Values::Flag(values) => values[row].into(),
        }
    }

    fn is_constant(&self) -> bool {
        fn equal<T: PartialEq>(values: &[T]) -> bool {
            !values.is_empty() && values.windows(2).all(|pair| pair[0] == pair[1])
        }
        match &self.values {
            Values::Text(values) => equal(values),
            Values::Number(values) => equal(values),
            Values::Count(values) => equal(values),
            Values::Flag(values) => equal(values),
        }
    }
}
