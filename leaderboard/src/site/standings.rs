//! The first tables of a protocol: its methods class by class and by rank, few columns first.

use std::collections::BTreeMap;

use maud::Markup;
use omnilife_schemas::records::Verification;

use super::{
    SiteRequest,
    html_table::{self, Addition, RowAddition},
    method_page,
};
use crate::{
    budget::{has_unusual_budget, usual_iterations},
    class::MethodClass,
    format::{self, PUBLISHED_LPIPS},
    group::{Group, MethodRow},
    layouts::{
        common_notes, mark_classes, order_in_words, published_layout, published_lpips,
        published_metrics, ranked_by, standings, variants_note,
    },
    published::{Paper, published_rows},
    quantity::{Quantity, ViewKind},
    remarks,
    table::{Cell, Column, Mark, Row, Table, cost_cells, cost_columns, method_rank, method_score},
};

/// The LPIPS in the first columns, if measured: the metric's own convention.
const FIRST_LPIPS: &str = "lpips-vgg";

/// Returns one method per row, with its page; nothing without scored novel views.
pub(super) fn render(request: &SiteRequest<'_>, group: &Group<'_>, id: &str) -> Option<Markup> {
    let ranked = ranked_by(group)?;
    let methods = standings(group);
    let columns = Columns::of(group);
    let usual = usual_iterations(&methods);
    let table = table(group, request.papers, &methods, &columns, ranked, &usual);
    let of_row = |at: usize| {
        let method = methods[at];
        RowAddition {
            page: Some(method_page::file(method.method)),
            detail: detail(group, method, request.verifications.get(method.method)),
            is_ranked: method.complete,
            links: Vec::new(),
        }
    };
    Some(html_table::render(
        &table,
        &Addition {
            id,
            first_columns: Some(columns.first),
            of_row: &of_row,
            is_ranking: true,
        },
    ))
}

enum Source {
    Score(usize),
    /// LPIPS without a result: the published one, or a missing measured variant.
    Unmeasured,
}

type ScoreColumn = (Source, Column);

struct Columns {
    scores: Vec<ScoreColumn>,
    /// Number of columns shown at first, training time and iterations among them.
    first: usize,
}

impl Columns {
    fn of(group: &Group<'_>) -> Self {
        let shown = first_scores(group);
        let mut scores: Vec<ScoreColumn> = shown
            .iter()
            .map(|&index| (Source::Score(index), Column::of_score(group, index, false)))
            .collect();
        let is_lpips = |index: &usize| group.quantities[*index].0.metric.starts_with("lpips");
        if !shown.iter().any(is_lpips) {
            scores.push((Source::Unmeasured, unmeasured_lpips(group)));
        }
        let first = scores.len() + FIRST_COSTS.len();
        let others = (0..group.quantities.len()).filter(|index| !shown.contains(index));
        scores.extend(others.map(|index| (Source::Score(index), full_column(group, index))));
        if group.quantity(ViewKind::Novel, PUBLISHED_LPIPS).is_none() {
            scores.push((Source::Unmeasured, published_lpips(ViewKind::Novel, false)));
        }
        Self { scores, first }
    }

    /// Returns the first columns of scores, and the others.
    fn split(&self) -> (&[ScoreColumn], &[ScoreColumn]) {
        self.scores.split_at(self.first - FIRST_COSTS.len())
    }
}

/// Returns the most important measured scores: PSNR, SSIM and one LPIPS of novel views, as indices of the group's
/// quantities.
pub(super) fn first_scores(group: &Group<'_>) -> Vec<usize> {
    let novel = published_metrics(group, ViewKind::Novel);
    let name = |index: usize| group.quantities[index].0.metric.as_str();
    let is_lpips = |index: &usize| name(*index).starts_with("lpips");
    let preferred = (novel.iter().copied()).find(|&index| name(index) == FIRST_LPIPS);
    let lpips = preferred.or_else(|| novel.iter().copied().find(is_lpips));
    let others = novel.iter().copied().filter(|index| !is_lpips(index));
    others.chain(lpips).collect()
}

/// Returns a column that names its kind of view.
pub(super) fn full_column(group: &Group<'_>, index: usize) -> Column {
    let mut column = Column::of_score(group, index, true);
    let kind = column.group.take().unwrap_or_default();
    column.name = format!("{kind} {}", column.name);
    column
}

/// Costs in the first columns, as indices of [`cost_columns`]: training time, iterations.
const FIRST_COSTS: [usize; 2] = [0, 3];

/// Returns the column of a metric of the protocol without any score.
fn unmeasured_lpips(group: &Group<'_>) -> Column {
    let reason = group.why_unavailable(ViewKind::Novel, FIRST_LPIPS);
    Column {
        name: format::metric_title(FIRST_LPIPS),
        missing: Some(reason.unwrap_or("no result has it").to_owned()),
        holds: crate::table::ColumnContent::Score(Quantity {
            kind: ViewKind::Novel,
            metric: FIRST_LPIPS.to_owned(),
        }),
        ..Column::plain("")
    }
}

fn table(
    group: &Group<'_>,
    papers: &[Paper],
    methods: &[&MethodRow<'_>],
    columns: &Columns,
    ranked: usize,
    usual: &BTreeMap<MethodClass, u64>,
) -> Table {
    let (first, others) = columns.split();
    let costs = cost_columns();
    let is_first = |at: &usize| FIRST_COSTS.contains(at);
    let mut headings: Vec<Column> = first.iter().map(|(_, column)| column.clone()).collect();
    headings.extend(FIRST_COSTS.map(|at| costs[at].clone()));
    headings.extend(others.iter().map(|(_, column)| column.clone()));
    headings.extend(
        (0..costs.len())
            .filter(|at| !is_first(at))
            .map(|at| costs[at].clone()),
    );
    headings.extend(["Scenes", "Failures"].map(Column::plain));
    let row = |method: &MethodRow<'_>| {
        let score = |(source, _): &ScoreColumn| match source {
            Source::Score(index) => method_score(group, method, *index),
            Source::Unmeasured => Cell::Missing,
        };
        let costs = cost_cells(&method.numbers);
        let mut cells: Vec<Cell> = first.iter().map(score).collect();
        cells.extend(FIRST_COSTS.map(|at| costs[at].clone()));
        cells.extend(others.iter().map(score));
        let other_costs = (0..costs.len()).filter(|at| !is_first(at));
        cells.extend(other_costs.map(|at| costs[at].clone()));
        cells.push(Cell::Text(format!(
            "{} of {}",
            method.scenes,
            group.scenes.len()
        )));
        cells.push(Cell::failures(&method.numbers));
        let mut marks = Mark::of(&method.numbers);
        marks.extend(has_unusual_budget(method, usual).then_some(Mark::OtherBudget));
        Row {
            names: vec![
                method_rank(method, ranked).plain(),
                method.method.to_owned(),
            ],
            cells,
            class: Some(method.class),
            failures: method.numbers.failures,
            marks,
        }
    };
    let mut rows: Vec<Row> = methods.iter().map(|method| row(method)).collect();
    let contestants: Vec<(MethodClass, bool)> = methods
        .iter()
        .map(|method| (method.class, method.complete))
        .collect();
    mark_classes(&mut rows, &contestants, &headings);
    let published = published_layout(group.protocol);
    let published = published_rows(papers, &published, group.protocol, &headings, 1);
    let mut notes = common_notes(group, "scene");
    notes.extend(variants_note(group));
    notes.extend(group.unavailable());
    notes.extend(published.notes);
    Table {
        title: format!(
            "Methods {}, protocol {}",
            order_in_words(group),
            group.protocol
        ),
        names: ["#", "Method"].map(str::to_owned).to_vec(),
        columns: headings,
        rows,
        published: published.blocks,
        notes,
    }
}

/// Returns the budget, and the reason why a method is not ranked.
fn detail(
    group: &Group<'_>,
    method: &MethodRow<'_>,
    verification: Option<&Verification>,
) -> Option<String> {
    let rows: Vec<_> = group.rows_of(method.method).collect();
    let iterations = crate::budget::iterations(method).filter(|&iterations| iterations > 0);
    let budget = iterations.map(|count| format::counted(count as usize, "iteration"));
    let (found, all) = (method.scenes, group.scenes.len());
    let scenes = (found < all).then(|| format!("{found} of {all} scenes"));
    let verified = verification.filter(|verification| verification.scored_again > 0);
    let verified = verified.map(Verification::in_words);
    let partial = method
        .numbers
        .partial
        .then(|| Mark::Partial.meaning().to_owned());
    let parts = [
        budget,
        scenes,
        verified,
        partial,
        remarks::why_incomplete(&rows),
    ];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}
