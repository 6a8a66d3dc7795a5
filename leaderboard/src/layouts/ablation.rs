//! Variants of a method, beside the whole: OmniLife360, Table 6.

use super::{common_notes, mark_classes, published_lpips, published_metrics};
use crate::{
    class::MethodClass,
    format::PUBLISHED_LPIPS,
    group::{Group, MethodRow},
    published::{OMNILIFE360, Paper, PublishedLayout, published_rows},
    quantity::ViewKind,
    table::{Cell, Column, Mark, Row, Table, cost_cells, cost_columns, method_score},
    variants,
};

/// The paper's table.
const PUBLISHED: PublishedLayout = PublishedLayout {
    paper: OMNILIFE360,
    numbers: &[6],
    protocol: "per-scene",
};

/// Returns one table for every method that has variants, where novel views are scored.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    if !group.has(ViewKind::Novel) {
        return Vec::new();
    }
    group
        .methods
        .iter()
        .filter_map(|whole| {
            let variants: Vec<&MethodRow<'_>> = (group.methods.iter())
                .filter(|method| method.whole == Some(whole.method))
                .collect();
            (!variants.is_empty()).then(|| table(group, papers, whole, &variants))
        })
        .collect()
}

fn table(
    group: &Group<'_>,
    papers: &[Paper],
    whole: &MethodRow<'_>,
    variants: &[&MethodRow<'_>],
) -> Table {
    let sources = published_metrics(group, ViewKind::Novel);
    let mut columns: Vec<Column> = sources
        .iter()
        .map(|&index| Column::of_score(group, index, false))
        .collect();
    let lpips_apart = group.quantity(ViewKind::Novel, PUBLISHED_LPIPS).is_none();
    if lpips_apart {
        columns.push(published_lpips(ViewKind::Novel, false));
    }
    columns.extend(cost_columns());
    let row = |name: String, method: &MethodRow<'_>| {
        let mut cells: Vec<Cell> = sources
            .iter()
            .map(|&index| method_score(group, method, index))
            .collect();
        cells.extend(lpips_apart.then_some(Cell::Missing));
        cells.extend(cost_cells(&method.numbers));
        Row {
            names: vec![name],
            cells,
            class: None,
            failures: method.numbers.failures,
            marks: Mark::of(&method.numbers),
        }
    };
    let mut rows: Vec<Row> = variants
        .iter()
        .map(|method| row(variants::label(whole.method, method.method), method))
        .collect();
    rows.push(row(format!("{} (full)", whole.method), whole));
    let methods = variants.iter().copied().chain([whole]);
    let contestants: Vec<(MethodClass, bool)> = methods
        .map(|method| (method.class, method.complete))
        .collect();
    mark_classes(&mut rows, &contestants, &columns);
    let published = published_rows(papers, &PUBLISHED, group.protocol, &columns, 1);
    let mut notes = common_notes(group, "scene");
    notes.extend(published.notes);
    Table {
        title: format!(
            "Ablation of {}, novel views, protocol {}, by component",
            whole.method, group.protocol
        ),
        names: vec!["Method".to_owned()],
        columns,
        rows,
        published: published.blocks,
        notes,
    }
}
