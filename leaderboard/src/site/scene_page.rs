//! One scene: its scores, what failed, and rendered views beside their ground truth.

use maud::{Markup, html};
use omnilife_schemas::{provenance, records::ResultRecord};

use super::{
    SiteRequest,
    comparisons::{Comparisons, Picture},
    html_table, layout,
    layout::Place,
};
use crate::{
    format,
    group::{Group, SceneRow},
    layouts::remarks,
    table::{Cell, Column, Row, Table, mark_standings},
};

pub(super) fn render(
    request: &SiteRequest<'_>,
    scene: &str,
    rows: &[(&Group<'_>, &SceneRow<'_>)],
    comparisons: &Comparisons,
) -> Markup {
    let groups: Vec<&[(&Group<'_>, &SceneRow<'_>)]> =
        rows.chunk_by(|a, b| std::ptr::eq(a.0, b.0)).collect();
    let remarks: Vec<String> = rows.iter().flat_map(|(_, row)| remarks(row)).collect();
    let content = html! {
        p { a href="../index.html" { "All scenes" } }
        @if !comparisons.by_view.is_empty() { (pictures(comparisons)) }
        @for (number, group) in groups.iter().enumerate() {
            h2 { "Protocol " (group[0].0.protocol) " (" (group[0].0.short_hash()) ")" }
            (html_table::render(&table(group), &format!("t{number}"), |_| None))
        }
        @if !remarks.is_empty() {
            h2 { "Remarks" }
            ul { @for remark in &remarks { li { (remark) } } }
        }
    };
    layout::page(Place::Scene, scene, request.dataset.is_some(), content)
}

/// One row per method and seed, with every metric.
fn table(rows: &[(&Group<'_>, &SceneRow<'_>)]) -> Table {
    let group = rows[0].0;
    let mut columns: Vec<Column> = (0..group.quantities.len())
        .map(|index| Column::of_score(group, index, true))
        .collect();
    columns.extend(crate::table::cost_columns());
    columns.extend(
        [
            "Rendering (s)",
            "Computed by",
            "Machine",
            "Commit",
            "Failures",
        ]
        .map(Column::plain),
    );
    let mut table_rows = Vec::new();
    let mut complete = Vec::new();
    for (_, row) in rows {
        for result in &row.results {
            let mut cells: Vec<Cell> = group
                .quantities
                .iter()
                .map(|(quantity, _)| {
                    let summary = quantity.kind.scores(result).get(&quantity.metric);
                    Cell::score(summary.map(|summary| summary.mean), &quantity.metric, None)
                })
                .collect();
            cells.extend([
                Cell::number(result.training_seconds, 1),
                Cell::number(result.peak_memory_bytes.map(|bytes| bytes as f64 / 1e9), 2),
                Cell::number(result.primitives.map(|count| count as f64), 0),
                Cell::number(result.iterations.map(|count| count as f64), 0),
                Cell::number(result.rendering_seconds, 1),
                text(result.backend.as_ref().map(format::backend)),
                text(result.hardware.as_ref().map(format::machine)),
                text(commit(result).map(format::short_commit)),
                Cell::count(result.failures.len()),
            ]);
            table_rows.push(Row {
                names: vec![
                    row.method.to_owned(),
                    result
                        .seed
                        .map_or_else(|| "–".to_owned(), |seed| seed.to_string()),
                ],
                cells,
                failures: result.failures.len(),
            });
            complete.push(result.failures.is_empty());
        }
    }
    let directions: Vec<_> = columns.iter().map(|column| column.direction).collect();
    mark_standings(table_rows.iter_mut().zip(complete), &directions);
    Table {
        title: "Scores of every method and seed".to_owned(),
        names: ["Method", "Seed"].map(str::to_owned).to_vec(),
        columns,
        rows: table_rows,
        published: Vec::new(),
        notes: vec![
            "Means over the views of the scene. Bold: best; underlined: second best; among runs \
             without failures."
                .to_owned(),
        ],
    }
}

fn text(text: Option<String>) -> Cell {
    text.map_or(Cell::Missing, Cell::Text)
}

/// The commit of the program that made the predictions, or else of the one that scored them.
fn commit(result: &ResultRecord) -> Option<&str> {
    let versions = [&result.run_versions, &result.versions];
    versions.into_iter().find_map(provenance::commit_in)
}

fn pictures(comparisons: &Comparisons) -> Markup {
    html! {
        h2 { "Rendered views" }
        p {
            (comparisons.by_view.len()) " of " (comparisons.views) " views. Left of the line is the \
             rendered view, right of it the ground truth; move the line with the slider. The error \
             map is the difference of the two, four times as bright."
        }
        @for pictures in comparisons.by_view.values() {
            h3 { (capitalized(&pictures[0].view)) }
            div.compare-grid { @for picture in pictures { (figure(picture)) } }
        }
        @if !comparisons.left_out.is_empty() {
            p { "Left out:" }
            ul { @for reason in &comparisons.left_out { li { (reason) } } }
        }
    }
}

/// Both halves of one picture on top of each other; the style sheet cuts at the slider's position.
fn figure(picture: &Picture) -> Markup {
    let [width, height] = picture.half;
    let what = format!("{} by {}", picture.view, picture.method);
    let style = format!(
        "--half-width: {width}; --half-height: {height}; --width-ratio: {:.6}; --truth-offset: {:.6}",
        picture.width_ratio(),
        picture.truth_offset()
    );
    html! {
        figure.compare style=(style) {
            div.stage {
                div.truth {
                    img src=(picture.file) alt={ "Ground truth of " (what) } loading="lazy";
                }
                div.prediction {
                    img src=(picture.file) alt={ "Rendering of " (what) } loading="lazy";
                }
            }
            label {
                span.visually-hidden { "Share of the rendered view, " (what) }
                input.split type="range" min="0" max="100" value="50" step="1";
            }
            figcaption {
                span { (picture.method) }
                label {
                    input.error-map type="checkbox";
                    " Error map" span.visually-hidden { ", " (what) }
                }
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
