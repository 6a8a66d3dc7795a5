//! Tables that sort, filter, rank by another score, and show further columns on request.

use std::{collections::BTreeMap, ops::Range};

use maud::{Markup, html};

use omnilife_schemas::records::Direction;

use crate::{
    class::MethodClass,
    format,
    table::{Cell, Column, PublishedBlock, Row, Score, ScoreRank, Table},
};

/// Number of rows below which tables need no filter, at least on a phone.
const SHORT: usize = 10;

/// A page's additions to a table.
pub(super) struct Addition<'a> {
    /// Unique on the page.
    pub(super) id: &'a str,
    /// Number of columns shown at first; the others follow on request. All if `None`.
    pub(super) first_columns: Option<usize>,
    /// Additions to a row, by its index in the table.
    pub(super) of_row: &'a dyn Fn(usize) -> RowAddition,
    /// True if the first name is a rank, which another choice of score replaces.
    pub(super) is_ranking: bool,
}

#[derive(Default)]
pub(super) struct RowAddition {
    /// Page of the first name, or of the second beside a rank.
    pub(super) page: Option<String>,
    /// A second line below the name.
    pub(super) detail: Option<String>,
    /// Texts and addresses of the row's sources.
    pub(super) links: Vec<(&'static str, String)>,
    /// True if it is ranked among the rows of its class.
    pub(super) is_ranked: bool,
}

/// Returns a table without additions.
pub(super) fn plain(table: &Table, id: &str) -> Markup {
    render(
        table,
        &Addition {
            id,
            first_columns: None,
            of_row: &|_| RowAddition::default(),
            is_ranking: false,
        },
    )
}

/// Returns a table with its notes, class by class; published figures are collapsed below.
pub(super) fn render(table: &Table, addition: &Addition<'_>) -> Markup {
    let notes = format!("{}-notes", addition.id);
    let first = addition.first_columns.unwrap_or(table.columns.len());
    let dashes = Dashes::of(table);
    let mut from = 0;
    let blocks = table.blocks().enumerate().map(|(number, rows)| {
        let part = Part {
            table,
            rows,
            from,
            id: match number {
                0 => addition.id.to_owned(),
                _ => format!("{}-{}", addition.id, number + 1),
            },
        };
        from += rows.len();
        html! {
            @if let Some(class) = part.class() { h3 { (class) } }
            (part.render(addition, first, &dashes, &notes))
        }
    });
    let blocks: Vec<Markup> = blocks.collect();
    html! {
        @for block in &blocks { (block) }
        div.notes #(notes) {
            (dashes.footnotes(0..first))
            @if dashes.any_from(first) || !table.notes.is_empty() {
                details {
                    summary { "Notes" }
                    (dashes.footnotes(first..table.columns.len()))
                    @for note in &table.notes { p { (note) } }
                }
            }
        }
        @for block in &table.published { (published(block, table)) }
    }
}

/// The rows of one class.
struct Part<'a> {
    table: &'a Table,
    rows: &'a [Row],
    /// Index of the first of them in the table.
    from: usize,
    id: String,
}

impl Part<'_> {
    fn class(&self) -> Option<&'static str> {
        let class = self.rows.first().and_then(|row| row.class);
        class.map(MethodClass::title)
    }

    /// Returns the title, with the class if there is one.
    fn title(&self) -> String {
        let title = &self.table.title;
        match self.class() {
            Some(class) => format!("{title}: {class}"),
            None => title.clone(),
        }
    }

    fn render(
        &self,
        addition: &Addition<'_>,
        first: usize,
        dashes: &Dashes<'_>,
        notes: &str,
    ) -> Markup {
        let (table, id, title) = (self.table, &self.id, self.title());
        html! {
            div.table-tools.short[self.rows.len() < SHORT] {
                @if addition.is_ranking { (ranking_choice(table, id)) }
                label.filter {
                    "Filter rows "
                    input type="search" data-filter=(id) autocomplete="off";
                }
                output data-count=(id) { (format::counted(self.rows.len(), "row")) }
                button type="button" data-all=(id) hidden { "Show all" }
                @if first < table.columns.len() {
                    label { input type="checkbox" data-columns=(id); " All columns" }
                }
            }
            div.scroll role="region" tabindex="0" aria-label=(title) {
                table.sortable.few[first < table.columns.len()].ranking[addition.is_ranking] #(id)
                    aria-describedby=(notes) {
                    caption.visually-hidden[addition.is_ranking] { span { (title) } }
                    thead {
                        (group_header(table))
                        tr {
                            @for name in &table.names { (heading(name, None, true, false)) }
                            @for (at, column) in table.columns.iter().enumerate() {
                                (heading(&column.name, column.direction, false, at >= first))
                            }
                        }
                    }
                    tbody.measured {
                        @for (at, row) in self.rows.iter().enumerate() {
                            @let of_row = (addition.of_row)(self.from + at);
                            (measured_row(row, &of_row, addition.is_ranking, |column, cell| {
                                measured_cell(cell, column >= first, dashes.reason(column))
                            }))
                        }
                    }
                }
            }
        }
    }
}

fn ranking_choice(table: &Table, id: &str) -> Markup {
    let names = table.names.len();
    html! {
        label {
            "Rank by "
            select data-rank=(id) {
                @for (at, column) in table.columns.iter().enumerate() {
                    @if column.direction.is_some() && is_scored(table, at) {
                        option value=(names + at) { (column.heading()) }
                    }
                }
            }
        }
    }
}

fn is_scored(table: &Table, column: usize) -> bool {
    let mut cells = table.rows.iter().map(|row| &row.cells[column]);
    cells.any(|cell| matches!(cell, Cell::Score(_)))
}

/// Reasons for dashes in cells of a table, by column.
struct Dashes<'a> {
    reasons: BTreeMap<usize, (&'a str, &'a str)>,
}

impl<'a> Dashes<'a> {
    fn of(table: &'a Table) -> Self {
        let missing = |at: usize| {
            let mut cells = table.rows.iter().map(|row| &row.cells[at]);
            cells.any(|cell| *cell == Cell::Missing)
        };
        let columns = table.columns.iter().enumerate();
        let reasons = columns.filter(|&(at, _)| missing(at)).map(|(at, column)| {
            let reason = column.missing.as_deref().unwrap_or("not scored");
            (at, (column.name.as_str(), reason))
        });
        Self {
            reasons: reasons.collect(),
        }
    }

    fn reason(&self, column: usize) -> &'a str {
        self.reasons
            .get(&column)
            .map_or("not scored", |&(_, reason)| reason)
    }

    fn any_from(&self, column: usize) -> bool {
        self.reasons.range(column..).next().is_some()
    }

    /// Returns one line per reason, with its columns.
    fn footnotes(&self, columns: Range<usize>) -> Markup {
        let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (_, (name, reason)) in self.reasons.range(columns) {
            let names = by_reason.entry(reason).or_default();
            if !names.contains(name) {
                names.push(name);
            }
        }
        html! {
            @for (reason, names) in &by_reason {
                p { "– in " (names.join(", ")) ": " (reason) "." }
            }
        }
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

fn heading(name: &str, direction: Option<Direction>, of_names: bool, later: bool) -> Markup {
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
        th.names[of_names].later[later] scope="col" aria-sort="none" data-first=(first) {
            button type="button" {
                (name)
                @if let (Some(direction), Some(better)) = (direction, better) {
                    // The arrow stays beside the name.
                    "\u{a0}" span aria-hidden="true" { (format::arrow(direction)) }
                    span.visually-hidden { " (" (better) ")" }
                }
            }
        }
    }
}

fn measured_row(
    row: &Row,
    addition: &RowAddition,
    is_ranking: bool,
    cell_of: impl Fn(usize, &Cell) -> Markup,
) -> Markup {
    let named = usize::from(is_ranking);
    let last = row.names.len().saturating_sub(1);
    let contest = row.class.filter(|_| addition.is_ranked);
    html! {
        tr data-contest=[contest.map(MethodClass::title)] {
            @for (position, name) in row.names.iter().enumerate() {
                @let is_rank = is_ranking && position == 0;
                th class=[is_rank.then_some("rank")] scope="row"
                    data-value=(if is_rank { rank_value(name) } else { name }) {
                    @match addition.page.as_ref().filter(|_| position == named) {
                        Some(page) => a href=(page) { (name) },
                        None => (name),
                    }
                    @for mark in row.marks.iter().filter(|_| position == last) {
                        " " abbr title=(mark.meaning()) { (mark.symbol()) }
                    }
                    @if let Some(detail) = addition.detail.as_ref().filter(|_| position == named) {
                        small { (detail) }
                    }
                    @if position == named && !addition.links.is_empty() {
                        small.links {
                            @for (text, address) in &addition.links {
                                a href=(address) { (text) } " "
                            }
                        }
                    }
                }
            }
            @for (at, cell) in row.cells.iter().enumerate() { (cell_of(at, cell)) }
        }
    }
}

/// Returns a rank without its interval; nothing without a rank.
fn rank_value(rank: &str) -> &str {
    let rank = rank.split_once(' ').map_or(rank, |(rank, _)| rank);
    if rank.parse::<usize>().is_ok() {
        rank
    } else {
        ""
    }
}

fn dash(reason: &str) -> Markup {
    html! { span.dash title=(reason) { "–" span.visually-hidden { " " (reason) } } }
}

/// Digits after the point of the sort keys of rows.
const SORTED_DIGITS: usize = 6;

fn measured_cell(cell: &Cell, later: bool, reason: &str) -> Markup {
    // Sort key of a row, if it differs from the text of the cell. Missing values have no number and stay at the end,
    // whichever way the column is sorted.
    let value = match cell {
        Cell::Score(Score { value, .. }) | Cell::Number { value, .. } => {
            Some(format!("{value:.SORTED_DIGITS$}"))
        }
        Cell::Rank { rank, .. } => Some(rank.to_string()),
        Cell::Missing => Some(String::new()),
        Cell::Text(_) | Cell::Blank => None,
    };
    html! {
        td class=[later.then_some("later")] data-value=[value] {
            @if *cell == Cell::Missing { (dash(reason)) } @else { (content(cell)) }
        }
    }
}

fn content(cell: &Cell) -> Markup {
    let Cell::Score(score) = cell else {
        return html! { (cell.plain()) };
    };
    let value = score.value();
    html! {
        @match score.standing {
            ScoreRank::Best => b title="best" { (value) },
            ScoreRank::Second => u title="second best" { (value) },
            ScoreRank::Other => (value),
        }
        @if score.interval.is_some() { small { (score.interval()) } }
    }
}

/// Returns figures of a paper, initially collapsed.
fn published(block: &PublishedBlock, table: &Table) -> Markup {
    let columns = block.columns();
    let names = block.rows.first().map_or(0, |row| row.names.len());
    let unnamed = table.names.len().saturating_sub(names);
    html! {
        details.published {
            summary { (block.source) }
            @for note in &block.notes { p { (note) } }
            div.scroll role="region" tabindex="0" aria-label=(block.source) {
                table {
                    thead {
                        tr {
                            @for name in &table.names[unnamed..] { th scope="col" { (name) } }
                            @for &at in &columns { th scope="col" { (table.columns[at].heading()) } }
                        }
                    }
                    tbody.published {
                        @for row in &block.rows {
                            tr {
                                @for name in &row.names { th scope="row" { (name) } }
                                @for &at in &columns {
                                    td {
                                        @if row.cells[at] == Cell::Missing {
                                            (dash("not in the paper's table"))
                                        } @else { (content(&row.cells[at])) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
