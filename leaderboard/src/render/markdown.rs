//! Markdown that reads well in a terminal too.

use omnilife_schemas::plain_text::for_markdown;

use super::{headings, marked_names};
use crate::{
    format,
    table::{Cell, Row, Standing, Table},
};

/// A table under a heading of `level`, with its notes.
pub(crate) fn render(table: &Table, level: usize) -> String {
    let mut lines = vec![
        format!("{} {}", "#".repeat(level), for_markdown(&table.title)),
        String::new(),
    ];
    lines.extend(body(table));
    for note in &table.notes {
        lines.push(String::new());
        lines.push(for_markdown(note));
    }
    lines.push(String::new());
    lines.join("\n")
}

/// The lines of the table alone.
pub(crate) fn body(table: &Table) -> Vec<String> {
    let headings: Vec<String> = headings(table)
        .iter()
        .map(|text| for_markdown(text))
        .collect();
    let mut rows = vec![headings];
    rows.extend(table.rows.iter().map(cells));
    for block in &table.published {
        let mut separator = vec![format!("*{}*", for_markdown(&block.source))];
        separator.resize(table.names.len() + table.columns.len(), String::new());
        rows.push(separator);
        rows.extend(block.rows.iter().map(cells));
    }
    aligned(&rows, table.names.len())
}

fn cells(row: &Row) -> Vec<String> {
    let names = marked_names(row)
        .iter()
        .map(|name| for_markdown(name))
        .collect();
    let mut cells: Vec<String> = names;
    cells.extend(row.cells.iter().map(cell));
    cells
}

fn cell(cell: &Cell) -> String {
    let Cell::Score(score) = cell else {
        return for_markdown(&format::plain(cell));
    };
    let (value, interval) = (format::value(score), format::interval(score));
    match score.standing {
        Standing::Best => format!("**{value}**{interval}"),
        Standing::Second => format!("*{value}*{interval}"),
        Standing::Other => format!("{value}{interval}"),
    }
}

/// Lines padded to equal width. The first row is the header; the first `text_columns` columns are
/// text, the others numbers.
fn aligned(rows: &[Vec<String>], text_columns: usize) -> Vec<String> {
    let count = rows.first().map_or(0, Vec::len);
    let widths: Vec<usize> = (0..count)
        .map(|column| {
            let cells = rows.iter().map(|row| row[column].chars().count());
            cells.max().unwrap_or(0).max(4)
        })
        .collect();
    let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
    let padded = |(column, (cell, &width)): (usize, (&String, &usize))| {
        if column < text_columns {
            format!("{cell:<width$}")
        } else {
            format!("{cell:>width$}")
        }
    };
    let mut lines: Vec<String> = rows
        .iter()
        .map(|row| line(row.iter().zip(&widths).enumerate().map(padded).collect()))
        .collect();
    let rule = widths.iter().enumerate().map(|(column, &width)| {
        if column < text_columns {
            "-".repeat(width)
        } else {
            "-".repeat(width - 1) + ":"
        }
    });
    lines.insert(1, line(rule.collect()));
    lines
}
