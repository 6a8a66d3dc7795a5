//! CSV for programs: one row per score.

use std::{io, path::Path};

use omnilife_schemas::{plain_text::for_spreadsheet, store::StoreError};

use crate::{
    class::MethodClass,
    table::{Cell, Row, Score, ScoreRank, Table},
};

/// Columns of a layout's file. `origin` is `measured` or `published`; `source` names the paper;
/// standings are within a `class`.
const HEADER: [&str; 14] = [
    "table",
    "origin",
    "source",
    "class",
    "row",
    "column",
    "value",
    "interval_low",
    "interval_high",
    "standing",
    "rank_low",
    "rank_high",
    "failures",
    "text",
];

/// Returns all tables of a layout, one row per cell. `path` is named in errors.
pub(crate) fn render(tables: &[Table], path: &Path) -> Result<Vec<u8>, StoreError> {
    let failed = |error: csv::Error| StoreError::write(path, io::Error::other(error));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(HEADER).map_err(failed)?;
    for table in tables {
        for row in &table.rows {
            for record in records(table, "measured", "", row) {
                writer.write_record(record).map_err(failed)?;
            }
        }
        for block in &table.published {
            for row in &block.rows {
                for record in records(table, "published", &block.source, row) {
                    writer.write_record(record).map_err(failed)?;
                }
            }
        }
    }
    writer
        .into_inner()
        .map_err(|error| StoreError::write(path, error.into_error()))
}

fn records(table: &Table, origin: &str, source: &str, row: &Row) -> Vec<[String; 14]> {
    let cells = table.columns.iter().zip(&row.cells);
    let class = row.class.map_or("", MethodClass::title);
    cells
        .filter_map(|(column, cell)| {
            let [value, low, high, standing, rank_low, rank_high, text] = fields(cell)?;
            let safe = |text: &str| for_spreadsheet(text).into_owned();
            Some([
                safe(&table.title),
                origin.to_owned(),
                safe(source),
                class.to_owned(),
                safe(&row.names.join(" / ")),
                // The arrow is for people.
                safe(
                    &[column.group.as_deref(), Some(column.name.as_str())]
                        .into_iter()
                        .flatten()
                        .collect::<Vec<_>>()
                        .join(" "),
                ),
                value,
                low,
                high,
                standing,
                rank_low,
                rank_high,
                row.failures.to_string(),
                text,
            ])
        })
        .collect()
}

/// Returns value, interval, standing, interval of the rank, text; `None` for an empty cell.
fn fields(cell: &Cell) -> Option<[String; 7]> {
    let empty = String::new;
    Some(match cell {
        Cell::Blank | Cell::Missing => return None,
        Cell::Score(score) => {
            let [low, high] = bounds(score);
            let standing = match score.standing {
                ScoreRank::Best => "best",
                ScoreRank::Second => "second",
                ScoreRank::Other => "",
            };
            let standing = standing.to_owned();
            [
                number(score.value),
                low,
                high,
                standing,
                empty(),
                empty(),
                empty(),
            ]
        }
        Cell::Number { value, remark, .. } => [
            number(*value),
            empty(),
            empty(),
            empty(),
            empty(),
            empty(),
            remark.trim().to_owned(),
        ],
        Cell::Rank { rank, interval, .. } => {
            let [low, high] = interval.map_or_else(
                || [empty(), empty()],
                |bounds| bounds.map(|bound| bound.to_string()),
            );
            [
                rank.to_string(),
                empty(),
                empty(),
                empty(),
                low,
                high,
                empty(),
            ]
        }
        Cell::Text(_) => {
            let text = for_spreadsheet(&cell.plain()).into_owned();
            [empty(), empty(), empty(), empty(), empty(), empty(), text]
        }
    })
}

fn bounds(score: &Score) -> [String; 2] {
    score.interval.map_or_else(
        || [String::new(), String::new()],
        |bounds| bounds.map(number),
    )
}

/// Formats with six digits after the point, which is more than scores have.
pub(crate) fn number(value: f64) -> String {
    format!("{value:.6}")
}
