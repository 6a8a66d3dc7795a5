//! All results, class by class and scene by scene: the printed table, `table.md`.

use std::collections::BTreeSet;

use omnilife_schemas::records::{Direction, ResultRecord};

use super::{best_first, mark_notes, order_in_words, published_metrics, remarks_of};
use crate::{
    aids,
    class::MethodClass,
    group::{Group, MethodRow, SceneRow},
    numbers::Numbers,
    quantity::ViewKind,
    repeats,
    table::{Cell, Column, Mark, Row, Table, cost_cells, mark_standings},
};

/// Metrics of the regions of an image, in the order of their columns.
pub(crate) const REGION_METRICS: [&str; 4] =
    ["psnr-static", "ssim-static", "psnr-dynamic", "ssim-dynamic"];

/// Returns one row per scene and method, then the means if there are several scenes; every class by itself.
pub(crate) fn table(group: &Group<'_>) -> Table {
    let columns = Columns::of(group);
    let classes: BTreeSet<MethodClass> = group.scene_rows.iter().map(|row| row.class).collect();
    let mut rows = Vec::new();
    for class in classes {
        rows.extend(rows_of_scenes(group, class, &columns));
        if group.scenes.len() > 1 {
            rows.extend(rows_of_means(group, class, &columns));
        }
    }
    Table {
        title: format!(
            "Protocol {} ({}), {}",
            group.protocol,
            group.short_hash(),
            order_in_words(group)
        ),
        names: ["Scene", "Method"].map(str::to_owned).to_vec(),
        columns: columns.columns,
        rows,
        published: Vec::new(),
        notes: notes(group),
    }
}

struct Columns {
    /// Quantities of the group in the first columns.
    sources: Vec<usize>,
    /// True if a scene has several results of one method.
    seeds: bool,
    columns: Vec<Column>,
}

impl Columns {
    fn of(group: &Group<'_>) -> Self {
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
        Self {
            sources,
            seeds,
            columns,
        }
    }

    fn directions(&self) -> Vec<Option<Direction>> {
        self.columns.iter().map(|column| column.direction).collect()
    }

    fn row(
        &self,
        group: &Group<'_>,
        class: MethodClass,
        names: [&str; 2],
        numbers: &Numbers,
        [seeds, views]: [Cell; 2],
    ) -> Row {
        let scores = self.sources.iter().map(|&index| {
            let metric = &group.quantities[index].0.metric;
            Cell::score(numbers.scores[index], metric, None)
        });
        let mut cells: Vec<Cell> = scores.collect();
        let [seconds, _, primitives, iterations] = cost_cells(numbers);
        cells.extend([seconds, primitives, iterations]);
        cells.extend(self.seeds.then_some(seeds));
        cells.extend([views, Cell::failures(numbers)]);
        Row {
            names: names.map(str::to_owned).to_vec(),
            cells,
            class: Some(class),
            failures: numbers.failures,
            marks: Mark::of(numbers),
        }
    }
}

/// Rows of the methods of a class, scene by scene: rivals have complete results of the same scene.
fn rows_of_scenes(group: &Group<'_>, class: MethodClass, columns: &Columns) -> Vec<Row> {
    let of_class = group.scene_rows.iter().filter(|row| row.class == class);
    let mut of_class: Vec<&SceneRow<'_>> = of_class.collect();
    let best_first = best_first(group);
    of_class.sort_by(|a, b| {
        let by_scene = a.scene.cmp(b.scene);
        by_scene.then_with(|| best_first(&a.numbers, &b.numbers))
    });
    let mut rows = Vec::new();
    for of_scene in of_class.chunk_by(|a, b| a.scene == b.scene) {
        let row = |row: &&SceneRow<'_>| {
            let seeds = Cell::count(row.results.len());
            let views = Cell::Text(views(row.results[0]));
            let names = [row.scene, row.method];
            columns.row(group, class, names, &row.numbers, [seeds, views])
        };
        let mut contest: Vec<Row> = of_scene.iter().map(row).collect();
        let complete = of_scene.iter().map(|row| row.numbers.are_whole());
        mark_standings(contest.iter_mut().zip(complete), &columns.directions());
        rows.extend(contest);
    }
    rows
}

/// Means of the methods of a class over scenes: rivals have complete results of all scenes.
fn rows_of_means(group: &Group<'_>, class: MethodClass, columns: &Columns) -> Vec<Row> {
    let of_class = group.methods.iter().filter(|method| method.class == class);
    let mut of_class: Vec<&MethodRow<'_>> = of_class.collect();
    let best_first = best_first(group);
    of_class.sort_by(|a, b| {
        let complete = b.complete.cmp(&a.complete);
        complete.then_with(|| best_first(&a.numbers, &b.numbers))
    });
    let row = |method: &&MethodRow<'_>| {
        let title = format!("mean of {} of {} scenes", method.scenes, group.scenes.len());
        let names = [title.as_str(), method.method];
        let blanks = [Cell::Blank, Cell::Blank];
        columns.row(group, class, names, &method.numbers, blanks)
    };
    let mut rows: Vec<Row> = of_class.iter().map(row).collect();
    let complete = of_class.iter().map(|method| method.complete);
    mark_standings(rows.iter_mut().zip(complete), &columns.directions());
    rows
}

/// Returns scores of static and dynamic regions: indices of the group's quantities.
fn region_metrics(group: &Group<'_>, kind: ViewKind) -> Vec<usize> {
    REGION_METRICS
        .iter()
        .filter_map(|metric| group.quantity(kind, metric))
        .collect()
}

/// Returns the scored input and novel views.
fn views(result: &ResultRecord) -> String {
    let scored = ViewKind::ALL.map(|kind| {
        let views = kind.scores(result).values().map(|summary| summary.views);
        views.max().unwrap_or(0)
    });
    format!("{} + {}", scored[0], scored[1])
}

/// Returns notes: facts to know before any score, the origin of the numbers, and other remarks of results.
fn notes(group: &Group<'_>) -> Vec<String> {
    let remarks = remarks_of(group);
    let mut lines: Vec<String> = remarks.serious().cloned().collect();
    lines.extend(repeats::warnings(group));
    lines.extend(aids::warning(group));
    lines.extend(aids::note(group));
    lines.push(
        "Input: the views that a method was given; Novel: the views that it had to predict. Scores \
         are means over the views of a scene; a dash means not scored. Views: scored input + novel \
         views. Only results of this protocol hash are compared."
            .to_owned(),
    );
    if group.scenes.len() > 1 {
        lines.push(
            "Mean rows are arithmetic means of the per-scene means, every scene with the same \
             weight; only methods with complete results on all scenes compete for the best mean."
                .to_owned(),
        );
    }
    lines.push(
        "Bold: best of at least two methods of a class with complete results, after rounding. \
         Italic: second best of at least three."
            .to_owned(),
    );
    lines.extend(mark_notes(group));
    lines.extend(group.other_regions());
    lines.extend(remarks.warnings);
    lines.extend(group.unavailable());
    lines
}
