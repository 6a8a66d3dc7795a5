//! Tables as text: one file per format.

pub(crate) mod csv;
pub(crate) mod latex;
pub(crate) mod markdown;

use crate::table::{Row, Table};

/// Marks a row with views that could not be scored.
pub(crate) const FAILURE_MARK: &str = "†";

/// A row's names, the last one marked where views failed.
fn marked_names(row: &Row) -> Vec<String> {
    let mut names = row.names.clone();
    if let Some(last) = names.last_mut().filter(|_| row.failures > 0) {
        last.push(' ');
        last.push_str(FAILURE_MARK);
    }
    names
}

/// All headings on one line.
fn headings(table: &Table) -> Vec<String> {
    let columns = table.columns.iter().map(crate::table::Column::heading);
    table.names.iter().cloned().chain(columns).collect()
}
