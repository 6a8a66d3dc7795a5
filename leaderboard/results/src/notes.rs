//! Lines that explain the gaps of an answer.

use polars::prelude::DataFrame;

use crate::{
    columns::{OF_DATASET, Table},
    error::ResultsError,
    frame::Selected,
    query::Query,
    source::Source,
};

/// Returns a line if a query uses columns of a dataset, and it has no facts for some results.
pub(crate) fn missing_facts(
    query: &Query,
    by: &[Selected],
    sources: &[Source<'_>],
) -> Option<String> {
    let filters = query.filters.iter().map(|filter| filter.column);
    let mut used = by.iter().map(|selected| selected.column).chain(filters);
    let without = sources
        .iter()
        .filter(|source| source.facts.is_none())
        .count();
    let asks = used.any(|column| OF_DATASET.iter().any(|own| own.name == column.name));
    (without > 0 && asks).then(|| {
        let all = sources.len();
        format!(
            "{without} of {all} results have scenes that no dataset tells anything of; --dataset names one"
        )
    })
}

/// Returns a line with the meaning of every column of a table's own that has empty cells among the keys of an answer.
///
/// # Errors
/// [`ResultsError::Table`] when the answer lacks a key.
pub(crate) fn empty_cells(
    table: &Table,
    keys: &[Selected],
    answer: &DataFrame,
) -> Result<Vec<String>, ResultsError> {
    let mut lines = Vec::new();
    for column in keys.iter().map(|key| key.column) {
        let (name, about) = (column.name, column.about);
        let (empty, rows) = (answer.column(name)?.null_count(), answer.height());
        if empty > 0 && table.own.iter().any(|own| own.name == name) {
            lines.push(format!(
                "{name} is empty in {empty} of {rows} rows: {about}"
            ));
        }
    }
    Ok(lines)
}
