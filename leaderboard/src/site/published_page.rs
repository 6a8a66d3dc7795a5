//! The tables of the papers, and their inconsistencies.

use maud::{Markup, html};

use super::{SiteRequest, layout, layout::Place};
use crate::{
    error::LeaderboardError,
    format,
    published::{Paper, PublishedCell, PublishedQuantity, PublishedRow, PublishedTable, findings},
};

pub(super) fn render(request: &SiteRequest<'_>) -> Result<Markup, LeaderboardError> {
    let findings = findings()?;
    let content = html! {
        p.lead {
            "As printed by their authors, on their scenes and with their variants of the metrics. \
             Nothing here was measured by this benchmark."
        }
        @for paper in request.papers {
            section {
                h2 { (paper.title) }
                p { (paper.about) }
                @let wrong = || findings.iter().filter(|finding| finding.paper == paper.id && !finding.holds);
                @if wrong().next().is_some() {
                    details {
                        summary { "What does not add up (" (wrong().count()) ")" }
                        ul {
                            @for finding in wrong() {
                                li {
                                    b { (finding.place) ". " } (finding.text)
                                    @for quote in &finding.quotes { " " q { (quote) } }
                                }
                            }
                        }
                    }
                }
                @for table in &paper.tables { (published(paper, table)) }
            }
        }
    };
    Ok(layout::page(
        request,
        Place::Published,
        "Published figures",
        content,
    ))
}

fn published(paper: &Paper, table: &PublishedTable) -> Markup {
    let caption = format!("Table {}: {}", table.number, table.title);
    html! {
        div.scroll.figures role="region" tabindex="0" aria-label={ (caption) ", " (paper.id) } {
            table {
                caption { span { (caption) } }
                thead { tr {
                    @for column in 0..table.columns.len() {
                        @let words = table.rows.iter().all(|row| row.cells[column].number().is_none());
                        th.words[words] scope="col" {
                            (paper.name_outside(&table.heading(column)))
                            (unit(table.columns[column].of.as_ref()))
                        }
                    }
                } }
                tbody.published {
                    @for row in &table.rows {
                        tr {
                            @for (column, cell) in row.cells.iter().enumerate() {
                                @let decimals = table.quantity(row, column).map_or(0, |of| of.decimals);
                                @if column == 0 {
                                    th scope="row" {
                                        (paper.name_outside(&cell.printed(decimals)))
                                        @if !names_metric(row) { (unit(row.of.as_ref())) }
                                    }
                                } @else if cell.text().is_some() {
                                    td.words {
                                        (cell.printed(decimals))
                                        @if column == 1 && names_metric(row) { (unit(row.of.as_ref())) }
                                    }
                                } @else {
                                    td { (number(cell, decimals)) }
                                }
                            }
                        }
                    }
                }
            }
        }
        div.notes { @for note in &table.notes { p { (note) } } }
    }
}

/// Returns true if the second cell of a row of one metric names it.
fn names_metric(row: &PublishedRow) -> bool {
    let is_text = row.cells.get(1).is_some_and(|cell| cell.text().is_some());
    row.of.is_some() && is_text
}

/// Returns the unit of numbers, if their metric does not imply it.
fn unit(quantity: Option<&PublishedQuantity>) -> Markup {
    let named =
        |of: &&PublishedQuantity| !["ratio", "distance", "count"].contains(&of.unit.as_str());
    html! {
        @if let Some(of) = quantity.filter(named) { "\u{a0}(" (of.unit) ")" }
    }
}

/// Returns a number as printed, with groups of three digits.
fn number(cell: &PublishedCell, decimals: usize) -> String {
    match cell {
        PublishedCell::Number(value) if decimals == 0 => format::grouped(*value),
        other => other.printed(decimals),
    }
}
