//! Markdown that reads well in a terminal too.

use omnilife_schemas::plain_text::for_markdown;

use super::{headings, marked_names};
use crate::{
    class::MethodClass,
    table::{Cell, Row, ScoreRank, Table},
};

/// Returns a table under a heading of `level`, class by class, with its notes; published rows are a table of their own
/// below.
pub(crate) fn render(table: &Table, level: usize) -> String {
    let marks = "#".repeat(level);
    let mut lines = vec![format!("{marks} {}", for_markdown(&table.title))];
    for (class, body) in blocks(table) {
        if let Some(class) = class {
            lines.extend([String::new(), format!("{marks}# {class}")]);
        }
        lines.push(String::new());
        lines.extend(body);
    }
    lines.extend(paragraphs(&table.notes));
    for block in &table.published {
        let source = for_markdown(&block.source);
        lines.extend([String::new(), format!("{marks}# {source}")]);
        lines.extend(paragraphs(&block.notes));
        lines.push(String::new());
        lines.extend(body(table, &block.rows, &block.columns(), for_markdown));
    }
    lines.push(String::new());
    lines.join("\n")
}

/// Lines of the measured rows of a class, with the class's title.
type Block = (Option<&'static str>, Vec<String>);

/// Makes a text harmless in a cell.
type Escape = fn(&str) -> String;

/// Returns the lines of the measured rows, class by class.
pub(crate) fn blocks(table: &Table) -> Vec<Block> {
    blocks_by(table, for_markdown)
}

/// Returns the lines for a terminal, which shows texts as they are.
pub(crate) fn terminal_blocks(table: &Table) -> Vec<Block> {
    blocks_by(table, str::to_owned)
}

fn blocks_by(table: &Table, escape: Escape) -> Vec<Block> {
    let all: Vec<usize> = (0..table.columns.len()).collect();
    let blocks = table.blocks().map(|rows| {
        let class = rows.first().and_then(|row| row.class);
        (
            class.map(MethodClass::title),
            body(table, rows, &all, escape),
        )
    });
    blocks.collect()
}

fn paragraphs(notes: &[String]) -> Vec<String> {
    let paragraphs = notes.iter().map(|note| [String::new(), for_markdown(note)]);
    paragraphs.flatten().collect()
}

/// Returns the lines of some rows under the headings of some columns.
fn body(table: &Table, rows: &[Row], columns: &[usize], escape: Escape) -> Vec<String> {
    let headings = headings(table, columns);
    let headings = headings.iter().map(|text| escape(text)).collect();
    let mut lines = vec![headings];
    lines.extend(rows.iter().map(|row| cells(row, columns, escape)));
    aligned(&lines, table.names.len())
}

fn cells(row: &Row, columns: &[usize], escape: Escape) -> Vec<String> {
    let names = marked_names(row);
    let mut cells: Vec<String> = names.iter().map(|name| escape(name)).collect();
    cells.extend(columns.iter().map(|&at| cell(&row.cells[at], escape)));
    cells
}

fn cell(cell: &Cell, escape: Escape) -> String {
    let Cell::Score(score) = cell else {
        return escape(&cell.plain());
    };
    let (value, interval) = (score.value(), score.interval());
    match score.standing {
        ScoreRank::Best => format!("**{value}**{interval}"),
        ScoreRank::Second => format!("*{value}*{interval}"),
        ScoreRank::Other => format!("{value}{interval}"),
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
