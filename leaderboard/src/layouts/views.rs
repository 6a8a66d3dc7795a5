//! Input and novel views: OmniLife360, Table 2.

use super::{
    common_notes, left_out, mark_classes, published_lpips, published_metrics, ranked_by, standings,
};
use crate::{
    class::{MethodClass, has_unusual_budget, usual_iterations},
    format::PUBLISHED_LPIPS,
    group::{Group, MethodRow, ViewKind},
    published::{Paper, PublishedLayout, published_rows},
    table::{Cell, Column, Row, Table, cost_cells, cost_columns, method_rank, method_score},
};

/// One table, where input views were scored.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    if !group.has(ViewKind::Input) {
        return Vec::new();
    }
    let title = format!("Input and novel views, protocol {}", group.protocol);
    vec![table(
        group,
        papers,
        title,
        &ViewKind::ALL,
        &PublishedLayout::Views,
    )]
}

/// Rows are methods, columns the published metrics of the given kinds of view, then rank and cost.
pub(super) fn table(
    group: &Group<'_>,
    papers: &[Paper],
    title: String,
    kinds: &[ViewKind],
    published: &PublishedLayout,
) -> Table {
    // Index of a measured quantity, or nothing for the column of published LPIPS.
    let mut sources: Vec<Option<usize>> = Vec::new();
    let mut columns = Vec::new();
    for &kind in kinds {
        for index in published_metrics(group, kind) {
            sources.push(Some(index));
            columns.push(Column::of_score(group, index, kinds.len() > 1));
        }
        if group.quantity(kind, PUBLISHED_LPIPS).is_none() {
            sources.push(None);
            columns.push(published_lpips(kind, kinds.len() > 1));
        }
    }
    let ranked = ranked_by(group);
    if ranked.is_some() {
        columns.push(Column::plain("Rank by novel PSNR"));
    }
    columns.push(Column::plain("Class"));
    columns.extend(cost_columns());
    columns.extend(["Scenes", "Failures"].map(Column::plain));
    let methods = standings(group);
    let usual = usual_iterations(&methods);
    let mut rows: Vec<Row> = methods
        .iter()
        .map(|method| Row {
            unusual_budget: has_unusual_budget(method, &usual),
            ..row(group, method, &sources, ranked)
        })
        .collect();
    let contestants: Vec<(MethodClass, bool)> = methods
        .iter()
        .map(|method| (method.class, method.complete))
        .collect();
    mark_classes(&mut rows, &contestants, &columns);
    let mut notes = common_notes(group);
    notes.extend(left_out(group));
    let published = published_rows(papers, published, group.protocol, &columns, 1);
    notes.extend(published.notes);
    Table {
        title,
        names: vec!["Method".to_owned()],
        columns,
        rows,
        published: published.blocks,
        notes,
    }
}

fn row(
    group: &Group<'_>,
    method: &MethodRow<'_>,
    sources: &[Option<usize>],
    ranked: Option<usize>,
) -> Row {
    let mut cells: Vec<Cell> = sources
        .iter()
        .map(|source| match source {
            Some(index) => method_score(group, method, *index),
            None => Cell::Missing,
        })
        .collect();
    cells.extend(ranked.map(|index| method_rank(method, index)));
    cells.push(Cell::Text(method.class.title(group).to_owned()));
    cells.extend(cost_cells(&method.numbers));
    cells.push(Cell::Text(format!(
        "{} of {}",
        method.scenes,
        group.scenes.len()
    )));
    cells.push(Cell::count(method.numbers.failures));
    Row {
        names: vec![method.method.to_owned()],
        cells,
        failures: method.numbers.failures,
        ..Row::default()
    }
}
