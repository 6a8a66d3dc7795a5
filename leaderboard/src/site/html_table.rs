//! Tables that sort and filter.

use maud::{Markup, html};

use omnilife_schemas::records::Direction;

use crate::{
    format,
    render::FAILURE_MARK,
    table::{Cell, Column, PublishedBlock, Row, Standing, Table},
};

/// A table with its filter and notes. `id` is unique on the page; `link` gives the page of a name
/// in the first column.
pub(super) fn render(table: &Table, id: &str, link: impl Fn(&str) -> Option<String>) -> Markup {
    let notes = format!("{id}-notes");
    html! {
        div.table-tools {
            label {
                "Filter rows "
                input type="search" data-filter=(id) autocomplete="off";
            }
            output data-count=(id) { (table.rows.len()) " rows" }
            button type="button" data-all=(id) hidden { "Show all" }
        }
        div.scroll role="region" tabindex="0" aria-label=(table.title) {
            table.sortable #(id) aria-describedby=(notes) {
                caption { (table.title) }
                thead {
                    (group_header(table))
                    tr {
                        @for name in &table.names { (heading(name, None, true)) }
                        @for column in &table.columns { (heading(&column.name, column.direction, false)) }
                    }
                }
                tbody.measured { @for row in &table.rows { (measured_row(row, &link)) } }
                @for block in &table.published {
                    (published(block, table.names.len() + table.columns.len()))
                }
            }
        }
        div.notes #(notes) { @for note in &table.notes { p { (note) } } }
    }
}

/// Headings over several columns.
fn group_header(table: &Table) -> Markup {
    let grouped = table.columns.iter().any(|column| column.group.is_some());
    html! {
        @if grouped {
            tr {
                @for _ in &table.names { td {} }
                @for same in table.columns.chunk_by(|a: &Column, b: &Column| a.group == b.group) {
                    @match &same[0].group {
                        Some(group) => th.group scope="colgroup" colspan=(same.len()) { (group) },
                        None => td colspan=(same.len()) {},
                    }
                }
            }
        }
    }
}

fn heading(name: &str, direction: Option<Direction>, of_names: bool) -> Markup {
    // The first click puts the best scores first.
    let first = match direction {
        Some(Direction::HigherIsBetter) => "descending",
        _ => "ascending",
    };
    let better = direction.map(|direction| match direction {
        Direction::HigherIsBetter => "higher is better",
        Direction::LowerIsBetter => "lower is better",
    });
    html! {
        th.names[of_names] scope="col" aria-sort="none" data-first=(first) {
            button type="button" {
                (name)
                @if let (Some(direction), Some(better)) = (direction, better) {
                    " " span aria-hidden="true" { (format::arrow(direction)) }
                    span.visually-hidden { " (" (better) ")" }
                }
            }
        }
    }
}

fn measured_row(row: &Row, link: &impl Fn(&str) -> Option<String>) -> Markup {
    let last = row.names.len().saturating_sub(1);
    html! {
        tr {
            @for (position, name) in row.names.iter().enumerate() {
                th scope="row" data-value=(name) {
                    @match link(name).filter(|_| position == 0) {
                        Some(page) => a href=(page) { (name) },
                        None => (name),
                    }
                    @if position == last && row.failures > 0 {
                        " " abbr title="Some views could not be scored" { (FAILURE_MARK) }
                    }
                }
            }
            @for cell in &row.cells { (measured_cell(cell)) }
        }
    }
}

fn measured_cell(cell: &Cell) -> Markup {
    // Missing values have no number and stay at the end, whichever way the column is sorted.
    let value = match cell {
        Cell::Score(score) => Some(score.value.to_string()),
        Cell::Number { value, .. } => Some(value.to_string()),
        Cell::Rank { rank, .. } => Some(rank.to_string()),
        Cell::Text(text) => Some(text.clone()),
        Cell::Missing | Cell::Blank => None,
    };
    html! {
        td data-value=(value.unwrap_or_default()) { (content(cell)) }
    }
}

fn content(cell: &Cell) -> Markup {
    let Cell::Score(score) = cell else {
        return html! { (format::plain(cell)) };
    };
    let value = format::value(score);
    html! {
        @match score.standing {
            Standing::Best => b title="best" { (value) },
            Standing::Second => u title="second best" { (value) },
            Standing::Other => (value),
        }
        @if score.interval.is_some() { small { (format::interval(score)) } }
    }
}

fn published(block: &PublishedBlock, columns: usize) -> Markup {
    html! {
        tbody.published {
            tr { th.source scope="rowgroup" colspan=(columns) { (block.source) } }
            @for row in &block.rows {
                tr {
                    @for name in &row.names { th scope="row" { (name) } }
                    @for cell in &row.cells { td { (content(cell)) } }
                }
            }
        }
    }
}
