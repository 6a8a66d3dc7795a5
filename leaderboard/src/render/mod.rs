//! Tables as text: one file per format.

pub(crate) mod csv;
pub(crate) mod latex;
pub(crate) mod markdown;

use crate::table::{Column, Row, Table};

/// Returns a row's names, the last one with the row's marks.
fn marked_names(row: &Row) -> Vec<String> {
    let mut names = row.names.clone();
    if let Some(last) = names.last_mut() {
        for mark in &row.marks {
            last.push(' ');
            last.push_str(mark.symbol());
        }
    }
    names
}

/// Returns the headings of the names and of some columns, each on one line.
fn headings(table: &Table, columns: &[usize]) -> Vec<String> {
    let columns = columns.iter().map(|&at| &table.columns[at]);
    let columns = columns.map(Column::heading);
    table.names.iter().cloned().chain(columns).collect()
}
