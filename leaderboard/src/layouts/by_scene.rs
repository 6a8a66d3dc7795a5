//! All results, scene by scene: the table that is printed, `table.md`.

use std::ops::Range;

use omnilife_schemas::records::ResultRecord;

use super::{mark_classes, published_metrics};
use crate::{
    class::MethodClass,
    group::{Group, Numbers, SceneRow, ViewKind},
    table::{Cell, Column, Row, Table},
};

/// Metrics of the regions of an image, in the order of their columns.
pub(crate) const REGION_METRICS: [&str; 4] =
    ["psnr-static", "ssim-static", "psnr-dynamic", "ssim-dynamic"];

/// One row per scene and method, then the means where there are several scenes.
pub(crate) fn table(group: &Group<'_>) -> Table {
    let sources: Vec<usize> = ViewKind::ALL
        .into_iter()
        .flat_map(|kind| [published_metrics(group, kind), region_metrics(group, kind)].concat())
        .collect();
    let seeds = group.scene_rows.iter().any(|row| row.results.len() > 1);
    let mut columns: Vec<Column> = sources
        .iter()
        .map(|&index| Column::of_score(group, index, true))
        .collect();
    columns.extend(["Training (s)", "Primitives", "Iterations"].map(Column::plain));
    columns.extend(seeds.then(|| Column::plain("Seeds")));
    columns.extend(["Views", "Failures"].map(Column::plain));
    let cells = |numbers: &Numbers, seeds_cell: Cell, views: Cell| {
        let metrics = sources.iter().map(|&index| {
            let metric = &group.quantities[index].0.metric;
            Cell::score(numbers.scores[index], metric, None)
        });
        let mut cells: Vec<Cell> = metrics.collect();
        cells.extend([
            Cell::number(numbers.training_seconds, 1),
            Cell::number(numbers.primitives, 0),
            Cell::number(numbers.iterations, 0),
        ]);
        cells.extend(seeds.then_some(seeds_cell));
        cells.extend([views, Cell::count(numbers.failures)]);
        cells
    };
    let row = |scene: &str, method: &str, cells: Vec<Cell>, failures: usize| Row {
        names: vec![scene.to_owned(), method.to_owned()],
        cells,
        failures,
        ..Row::default()
    };
    let mut rows: Vec<Row> = group
        .scene_rows
        .iter()
        .map(|scene_row| {
            let seeds = Cell::count(scene_row.results.len());
            let views = Cell::Text(views(scene_row.results[0]));
            let cells = cells(&scene_row.numbers, seeds, views);
            let failures = scene_row.numbers.failures;
            row(scene_row.scene, scene_row.method, cells, failures)
        })
        .collect();
    for contest in contests(&group.scene_rows) {
        let contestants: Vec<(MethodClass, bool)> = group.scene_rows[contest.clone()]
            .iter()
            .map(|row| (row.class, row.numbers.failures == 0))
            .collect();
        mark_classes(&mut rows[contest], &contestants, &columns);
    }
    if group.scenes.len() > 1 {
        let mut means: Vec<Row> = group
            .methods
            .iter()
            .map(|method| {
                let title = format!("mean of {} of {} scenes", method.scenes, group.scenes.len());
                let cells = cells(&method.numbers, Cell::Blank, Cell::Blank);
                row(&title, method.method, cells, method.numbers.failures)
            })
            .collect();
        let contestants: Vec<(MethodClass, bool)> = (group.methods.iter())
            .map(|method| (method.class, method.complete))
            .collect();
        mark_classes(&mut means, &contestants, &columns);
        rows.extend(means);
    }
    Table {
        title: format!("Protocol {} ({})", group.protocol, group.short_hash()),
        names: ["Scene", "Method"].map(str::to_owned).to_vec(),
        columns,
        rows,
        published: Vec::new(),
        notes: notes(group),
    }
}

/// Scores of what stands still and of what moves: indices of the group's quantities.
fn region_metrics(group: &Group<'_>, kind: ViewKind) -> Vec<usize> {
    REGION_METRICS
        .iter()
        .filter_map(|metric| group.quantity(kind, metric))
        .collect()
}

/// Rows of one scene: rivals are the methods that scored all views of the same scene.
fn contests(rows: &[SceneRow<'_>]) -> Vec<Range<usize>> {
    let mut begin = 0;
    rows.chunk_by(|a, b| a.scene == b.scene)
        .map(|scene| {
            let range = begin..begin + scene.len();
            begin = range.end;
            range
        })
        .collect()
}

/// Scored input and novel views.
fn views(result: &ResultRecord) -> String {
    let scored = ViewKind::ALL.map(|kind| {
        let views = kind.scores(result).values().map(|summary| summary.views);
        views.max().unwrap_or(0)
    });
    format!("{} + {}", scored[0], scored[1])
}

/// How the numbers were made, what failed and what the results remark.
fn notes(group: &Group<'_>) -> Vec<String> {
    let mut lines = vec![
        "Input: the views that a method was given; Novel: the views that it had to predict. Scores \
         are means over the views of a scene; a dash means not scored. Views: scored input + novel \
         views. Only results of this protocol hash are compared."
            .to_owned(),
    ];
    if group.scenes.len() > 1 {
        lines.push(
            "Mean rows are arithmetic means of the per-scene means, every scene with the same \
             weight; only methods with complete results on all scenes compete for the best mean."
                .to_owned(),
        );
    }
    lines.push(
        "Bold: best of at least two methods of a class (with training or without) that have no \
         failures, after rounding. Italic: second best of at least three."
            .to_owned(),
    );
    if group.scene_rows.iter().any(|row| row.numbers.failures > 0) {
        lines.push(
            "† Some views could not be scored; the means are over the others and are not \
             comparable."
                .to_owned(),
        );
    }
    lines.extend(group.other_regions());
    lines.extend(group.unavailable());
    lines.extend(group.scene_rows.iter().flat_map(remarks));
    lines
}

/// First failures and warnings of a method on a scene, each remark once.
pub(crate) fn remarks(row: &SceneRow<'_>) -> Vec<String> {
    let mut remarks: Vec<String> = Vec::new();
    for result in &row.results {
        let mut title = format!("{}, {}", row.scene, row.method);
        if let Some(seed) = result.seed.filter(|_| row.results.len() > 1) {
            title.push_str(&format!(", seed {seed}"));
        }
        if let Some(first) = result.failures.first() {
            remarks.push(format!(
                "{title}: {} of its views failed, the first is {} view {}: {}",
                result.failures.len(),
                first.view,
                first.frame,
                first.reason
            ));
        }
        remarks.extend(
            result
                .warnings
                .iter()
                .map(|warning| format!("{title}: {warning}")),
        );
    }
    remarks
}
