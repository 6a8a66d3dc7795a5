//! Tables as text: one file per format.

pub(crate) mod csv;
pub(crate) mod latex;
pub(crate) mod markdown;

use crate::table::{Row, Table};

/// Marks a row with views that could not be scored.
pub(crate) const FAILURE_MARK: &str = "†";

/// Marks a row that was trained for other iterations than is usual in its class.
pub(crate) const BUDGET_MARK: &str = "‡";

/// A row's names, the last one marked where views failed or its budget is another.
fn marked_names(row: &Row) -> Vec<String> {
    let mut names = row.names.clone();
    let marks = [
        (row.failures > 0).then_some(FAILURE_MARK),
        row.unusual_budget.then_some(BUDGET_MARK),
    ];
    if let Some(last) = names.last_mut() {
        for mark in marks.into_iter().flatten() {
            last.push(' ');
            last.push_str(mark);
        }
    }
    names
}

/// All headings on one line.
fn headings(table: &Table) -> Vec<String> {
    let columns = table.columns.iter().map(crate::table::Column::heading);
    table.names.iter().cloned().chain(columns).collect()
}
