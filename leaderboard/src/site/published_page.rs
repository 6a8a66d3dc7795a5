//! The tables of the papers, and what does not add up in them.

use maud::{Markup, html};

use super::{SiteRequest, layout, layout::Place};
use crate::{
    error::LeaderboardError,
    published::{Paper, PublishedTable, findings},
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
        div.scroll role="region" tabindex="0" aria-label={ (caption) ", " (paper.id) } {
            table {
                caption { (caption) }
                thead { tr {
                    @for column in 0..table.columns.len() {
                        @let words = table.rows.iter().all(|row| row.cells[column].number().is_none());
                        th.words[words] scope="col" { (paper.name_outside(&table.heading(column))) }
                    }
                } }
                tbody.published {
                    @for row in &table.rows {
                        tr {
                            @for (column, cell) in row.cells.iter().enumerate() {
                                @let decimals = table.quantity(row, column).map_or(0, |of| of.decimals);
                                @if column == 0 {
                                    th scope="row" { (paper.name_outside(&cell.printed(decimals))) }
                                } @else if cell.text().is_some() {
                                    td.words { (cell.printed(decimals)) }
                                } @else {
                                    td { (cell.printed(decimals)) }
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
