//! Input and novel views: OmniLife360, Table 2.

use super::{
    common_notes, feed_forward, left_out, mark_classes, order_in_words, published_layout,
    published_lpips, published_metrics, ranked_by, standings,
};
use crate::{
    budget::{has_unusual_budget, usual_iterations},
    class::MethodClass,
    format::PUBLISHED_LPIPS,
    group::{Group, MethodRow},
    published::{OMNILIFE360, Paper, PublishedLayout, published_rows},
    quantity::ViewKind,
    table::{Cell, Column, Mark, Row, Table, cost_cells, cost_columns, method_rank, method_score},
};

/// The paper's table.
pub(super) const PUBLISHED: PublishedLayout = PublishedLayout {
    paper: OMNILIFE360,
    numbers: &[2],
    protocol: "per-scene",
};

/// Returns one table, of the scored kinds of view.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    let kinds = ViewKind::ALL.into_iter().filter(|&kind| group.has(kind));
    let kinds: Vec<ViewKind> = kinds.collect();
    if kinds.is_empty() || feed_forward::is_of(group) {
        return Vec::new();
    }
    let published = published_layout(group.protocol);
    vec![table(group, papers, &kinds, published)]
}

/// Rows are methods, columns the published metrics of the given kinds of view, then rank and cost.
pub(super) fn table(
    group: &Group<'_>,
    papers: &[Paper],
    kinds: &[ViewKind],
    published: PublishedLayout,
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
        columns.push(Column::plain("Rank"));
    }
    columns.extend(cost_columns());
    columns.extend(["Scenes", "Failures"].map(Column::plain));
    let methods = standings(group);
    let usual = usual_iterations(&methods);
    let mut rows: Vec<Row> = methods
        .iter()
        .map(|method| {
            let mut row = row(group, method, &sources, ranked);
            if has_unusual_budget(method, &usual) {
                row.marks.push(Mark::OtherBudget);
            }
            row
        })
        .collect();
    let contestants: Vec<(MethodClass, bool)> = methods
        .iter()
        .map(|method| (method.class, method.complete))
        .collect();
    mark_classes(&mut rows, &contestants, &columns);
    let mut notes = common_notes(group, "scene");
    notes.extend(left_out(group));
    let published = published_rows(papers, &published, group.protocol, &columns, 1);
    notes.extend(published.notes);
    let views = match kinds {
        [ViewKind::Input] => "Input views",
        [ViewKind::Novel] => "Novel views",
        _ => "Input and novel views",
    };
    Table {
        title: format!(
            "{views}, protocol {}, {}",
            group.protocol,
            order_in_words(group)
        ),
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
    cells.extend(cost_cells(&method.numbers));
    cells.push(Cell::Text(format!(
        "{} of {}",
        method.scenes,
        group.scenes.len()
    )));
    cells.push(Cell::failures(&method.numbers));
    Row {
        names: vec![method.method.to_owned()],
        cells,
        class: Some(method.class),
        failures: method.numbers.failures,
        marks: Mark::of(&method.numbers),
    }
}
