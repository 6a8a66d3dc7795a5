//! The page of a scene: rendered views over their ground truth, scores, curves, and failures.

use std::collections::BTreeMap;

use maud::{Markup, html};
use omnilife_schemas::{provenance, records::ResultRecord};

use super::{
    SiteRequest,
    comparisons::{ComparisonImage, Comparisons},
    html_table::{self, Addition, RowAddition},
    layout,
    layout::Place,
    method_page, panorama, run_time,
    standings::{first_scores, full_column},
};
use crate::{
    class::MethodClass,
    error::LeaderboardError,
    format,
    group::{Group, SceneRow},
    layouts::{best_first, mark_classes, mark_notes, order_in_words, ranked_by},
    remarks::Remarks,
    table::{Cell, Column, Mark, Row, Table, cost_cells, cost_columns},
};

/// Name of a table's row, the method on a scene, and one of its results.
pub(super) type Run<'a> = (&'a str, &'a SceneRow<'a>, &'a ResultRecord);

pub(super) fn render(
    request: &SiteRequest<'_>,
    scene: &str,
    rows: &[(&Group<'_>, &SceneRow<'_>)],
    comparisons: &Comparisons,
) -> Result<Markup, LeaderboardError> {
    let groups: Vec<&[(&Group<'_>, &SceneRow<'_>)]> =
        rows.chunk_by(|a, b| std::ptr::eq(a.0, b.0)).collect();
    let mut sections = Vec::new();
    for (number, rows) in groups.iter().enumerate() {
        sections.push(section(request, scene, rows, comparisons, number)?);
    }
    let content = html! {
        p { a href="../index.html#scenes" { "All scenes" } }
        @if comparisons.images().any(|image| image.is_sphere) { (panorama::tools()) }
        @for section in &sections { (section) }
        @if !comparisons.left_out.is_empty() {
            h2 { "Images left out" }
            ul { @for reason in &comparisons.left_out { li { (reason) } } }
        }
    };
    Ok(layout::page(request, Place::Scene, scene, content))
}

/// Facts to know before any score, in a box.
pub(super) fn warning_box(remarks: &Remarks) -> Markup {
    html! {
        @if remarks.serious().next().is_some() {
            div.warning role="note" {
                ul { @for line in remarks.serious() { li { (line) } } }
            }
        }
    }
}

/// Returns the other warnings of the runs.
pub(super) fn other_warnings(remarks: &Remarks) -> Markup {
    html! {
        @if !remarks.warnings.is_empty() {
            h3 { "Notes of the runs" }
            ul { @for line in &remarks.warnings { li { (line) } } }
        }
    }
}

fn section(
    request: &SiteRequest<'_>,
    scene: &str,
    rows: &[(&Group<'_>, &SceneRow<'_>)],
    comparisons: &Comparisons,
    number: usize,
) -> Result<Markup, LeaderboardError> {
    let group = rows[0].0;
    let rows = by_score(group, rows);
    let remarks = Remarks::of(&rows);
    let runs: Vec<Run<'_>> = (rows.iter())
        .flat_map(|row| row.results.iter().map(|result| (row.method, *row, *result)))
        .collect();
    let of_row = |at: usize| {
        let (method, _, result) = runs[at];
        RowAddition {
            page: Some(format!("../{}", method_page::file(method))),
            detail: result.why_incomplete(),
            links: request.links(result),
            ..RowAddition::default()
        }
    };
    let table = table(
        group,
        &format!("Methods {}", order_in_words(group)),
        "Method",
        &runs,
        true,
    );
    // The first of several seeds, as for the images.
    let curves: Vec<(&str, MethodClass, &ResultRecord)> = (rows.iter())
        .map(|row| (row.method, row.class, row.results[0]))
        .collect();
    let title = format!(
        "Error against run time on {scene}, protocol {}",
        group.protocol
    );
    Ok(html! {
        h2 { "Protocol " (group.protocol) " " small { code { (group.short_hash()) } } }
        (images(comparisons, group, &rows))
        (warning_box(&remarks))
        div.board {
            div {
                (html_table::render(&table, &Addition {
                    id: &format!("t{number}"),
                    first_columns: Some(first_columns(group)),
                    of_row: &of_row,
                    is_ranking: false,
                }))
            }
            div {
                h3 { "Error against run time" }
                (run_time::of_results(request, &title, &curves)?)
            }
        }
        (other_warnings(&remarks))
    })
}

/// Sorts methods by class, then by their ranking score; incomplete ones come last.
fn by_score<'a>(
    group: &Group<'_>,
    rows: &[(&'a Group<'a>, &'a SceneRow<'a>)],
) -> Vec<&'a SceneRow<'a>> {
    let mut rows: Vec<&SceneRow<'_>> = rows.iter().map(|(_, row)| *row).collect();
    let best_first = best_first(group);
    rows.sort_by(|a, b| {
        let by_class = a.class.cmp(&b.class);
        by_class.then_with(|| best_first(&a.numbers, &b.numbers))
    });
    rows
}

/// Returns how many columns of [`table`] are shown at first: the first scores, training time, iterations.
pub(super) fn first_columns(group: &Group<'_>) -> usize {
    first_scores(group).len() + 2
}

/// Returns one row per run, the most important scores first.
pub(super) fn table(
    group: &Group<'_>,
    title: &str,
    named_by: &str,
    runs: &[Run<'_>],
    is_contest: bool,
) -> Table {
    let first = first_scores(group);
    let others = (0..group.quantities.len()).filter(|index| !first.contains(index));
    let others: Vec<usize> = others.collect();
    let costs = cost_columns();
    let mut columns: Vec<Column> = (first.iter())
        .map(|&index| full_column(group, index))
        .collect();
    columns.extend([costs[0].clone(), costs[3].clone()]);
    columns.extend(others.iter().map(|&index| full_column(group, index)));
    columns.extend([costs[1].clone(), costs[2].clone()]);
    let plain = ["Rendering (s)", "Computed by", "Machine", "Commit"];
    columns.extend(plain.map(|name| Column {
        missing: costs[0].missing.clone(),
        ..Column::plain(name)
    }));
    columns.push(Column::plain("Failures"));
    let mut rows: Vec<Row> = (runs.iter())
        .map(|&(name, row, result)| {
            let numbers = group.numbers_of(result);
            let score = |&index: &usize| {
                let metric = &group.quantities[index].0.metric;
                Cell::score(numbers.scores[index], metric, None)
            };
            let [seconds, memory, primitives, iterations] = cost_cells(&numbers);
            let mut cells: Vec<Cell> = first.iter().map(score).collect();
            cells.extend([seconds, iterations]);
            cells.extend(others.iter().map(score));
            let rendering = result.rendering_seconds.filter(|_| !numbers.failed);
            cells.extend([
                memory,
                primitives,
                Cell::number(rendering, 1),
                text(result.backend.as_ref().map(format::backend)),
                text(machine(result)),
                text(commit(result).map(format::short_commit)),
                Cell::failures(&numbers),
            ]);
            let seed = result.seed.map(|seed| seed.to_string());
            Row {
                names: vec![name.to_owned(), seed.unwrap_or_else(|| "–".to_owned())],
                cells,
                class: is_contest.then_some(row.class),
                failures: numbers.failures,
                marks: Mark::of(&numbers),
            }
        })
        .collect();
    let mut notes = vec!["Means over the views of the scene.".to_owned()];
    notes.extend(mark_notes(group));
    if is_contest {
        let contestants: Vec<(MethodClass, bool)> = (runs.iter())
            .map(|(_, row, result)| (row.class, group.numbers_of(result).are_whole()))
            .collect();
        mark_classes(&mut rows, &contestants, &columns);
        notes.push(
            "Bold: best of a class; underlined: second best; among complete results.".to_owned(),
        );
    }
    Table {
        title: title.to_owned(),
        names: [named_by, "Seed"].map(str::to_owned).to_vec(),
        columns,
        rows,
        published: Vec::new(),
        notes,
    }
}

fn text(text: Option<String>) -> Cell {
    text.map_or(Cell::Missing, Cell::Text)
}

/// Returns the machine of a run, measured or else stated by its authors.
pub(super) fn machine(result: &ResultRecord) -> Option<String> {
    let measured = result.hardware.as_ref().map(format::machine);
    measured.or_else(|| {
        let stated = result.statement.as_ref()?.hardware.as_ref()?;
        Some(format!("{stated} (as its authors state)"))
    })
}

/// Returns the commit of the program that made the predictions, or else of the one that scored them.
pub(super) fn commit(result: &ResultRecord) -> Option<&str> {
    let versions = [&result.run_versions, &result.versions];
    versions.into_iter().find_map(provenance::commit_in)
}

/// Views of one protocol, the first one open.
fn images(comparisons: &Comparisons, group: &Group<'_>, rows: &[&SceneRow<'_>]) -> Markup {
    let order: BTreeMap<&str, usize> = (rows.iter().enumerate())
        .map(|(at, row)| (row.method, at))
        .collect();
    let views: Vec<Vec<&ComparisonImage>> = (comparisons.by_view.values())
        .map(|images| {
            let of_protocol = |image: &&ComparisonImage| image.protocol_hash == group.protocol_hash;
            let mut images: Vec<&ComparisonImage> = images.iter().filter(of_protocol).collect();
            images.sort_by_key(|image| order.get(image.method.as_str()));
            images
        })
        .filter(|images| !images.is_empty())
        .collect();
    let score = |image: &ComparisonImage| {
        let at = order.get(image.method.as_str());
        let score = ranked_by(group).zip(at);
        let score = score.and_then(|(index, &at)| rows[at].numbers.scores[index]);
        score.map_or_else(String::new, |score| {
            format!(" · {score:.2} dB on this scene")
        })
    };
    html! {
        @for (number, images) in views.iter().enumerate() {
            details.view open[number == 0] {
                summary { (capitalized(&images[0].view)) }
                div.compare-grid {
                    @for image in images {
                        (panorama::figure(image, "", &html! {
                            span {
                                a href={ "../" (method_page::file(&image.method)) } { (image.method) }
                                (score(image))
                            }
                        }))
                    }
                }
            }
        }
        @if !views.is_empty() {
            p.notes {
                (views.len()) " of "
                (comparisons.views.get(group.protocol_hash).copied().unwrap_or_default())
                " views. The error map is the difference of \
                 rendering and truth, four times as bright."
            }
        }
    }
}

fn capitalized(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |first| {
        first.to_uppercase().collect::<String>() + characters.as_str()
    })
}
