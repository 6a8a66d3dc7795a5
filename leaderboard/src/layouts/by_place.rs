//! Novel views by place (all sequences cut from one video): all metrics as in OmniLife360,
//! Table 4, and PSNR alone as in its comparison with 4DGS methods, Table 5.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::records::Direction;

use super::{common_notes, left_out, main_methods, order::better_first, published_metrics};
use crate::{
    class::MethodClass,
    format,
    group::{Group, MethodRow, place},
    published::{OMNILIFE360, Paper, PublishedLayout, published_rows},
    quantity::ViewKind,
    table::{Cell, Column, ColumnContent, Mark, Row, Table, mark_standings},
};

/// Maximum number of places side by side; others go to further tables.
const PLACES: usize = 8;

struct PlaceLayout {
    /// True if it has all metrics and, in its first column, the average over all places.
    with_average: bool,
    /// The paper's table.
    published: PublishedLayout,
}

/// Rows are methods and metrics; the first column is the average over all places.
pub(super) fn all_metrics(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    let layout = PlaceLayout {
        with_average: true,
        published: PublishedLayout {
            paper: OMNILIFE360,
            numbers: &[4],
            protocol: "per-scene",
        },
    };
    tables(group, papers, &layout)
}

/// Rows are methods.
pub(super) fn psnr_alone(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    let layout = PlaceLayout {
        with_average: false,
        published: PublishedLayout {
            paper: OMNILIFE360,
            numbers: &[5],
            protocol: "per-scene",
        },
    };
    tables(group, papers, &layout)
}

fn tables(group: &Group<'_>, papers: &[Paper], layout: &PlaceLayout) -> Vec<Table> {
    let with_average = layout.with_average;
    let metrics: Vec<usize> = published_metrics(group, ViewKind::Novel)
        .into_iter()
        .filter(|&index| with_average || group.quantities[index].0.metric == "psnr")
        .collect();
    let means = PlaceMeans::of(group, &metrics);
    let places: Vec<&str> = means.places.clone();
    let parts = places.len().div_ceil(PLACES);
    if metrics.is_empty() || places.len() < 2 {
        return Vec::new();
    }
    places
        .chunks(PLACES)
        .enumerate()
        .map(|(part, places)| {
            let kind = if with_average {
                "Novel views"
            } else {
                "PSNR of novel views"
            };
            let part = match parts {
                1 => String::new(),
                _ => format!(", part {} of {parts}", part + 1),
            };
            let (first, _) = &group.quantities[metrics[0]];
            let title = format!(
                "{kind} by scene, protocol {}, by average {}, best first{part}",
                group.protocol,
                format::metric_title(&first.metric)
            );
            table(group, papers, layout, title, &metrics, &means, places)
        })
        .collect()
}

/// Scores of every method and place: means over the place's scenes.
struct PlaceMeans<'a> {
    places: Vec<&'a str>,
    /// By method and place.
    sums: BTreeMap<(&'a str, &'a str), PlaceSum>,
    /// Scenes of every place.
    scenes: BTreeMap<&'a str, usize>,
}

/// Scores of one method in one place.
struct PlaceSum {
    /// Sums over scenes, in the order of the metrics given.
    scores: Vec<Option<f64>>,
    scenes: usize,
    /// True if all results stand for the whole protocol.
    complete: bool,
}

impl<'a> PlaceMeans<'a> {
    fn of(group: &Group<'a>, metrics: &[usize]) -> Self {
        let mut scenes: BTreeMap<&str, usize> = BTreeMap::new();
        for scene in &group.scenes {
            *scenes.entry(place(scene)).or_default() += 1;
        }
        let mut sums = BTreeMap::new();
        for row in &group.scene_rows {
            let sum = sums
                .entry((row.method, place(row.scene)))
                .or_insert_with(|| PlaceSum {
                    scores: vec![Some(0.0); metrics.len()],
                    scenes: 0,
                    complete: true,
                });
            for (total, &index) in sum.scores.iter_mut().zip(metrics) {
                *total = total.zip(row.numbers.scores[index]).map(|(a, b)| a + b);
            }
            sum.scenes += 1;
            sum.complete &= row.numbers.are_whole();
        }
        Self {
            places: scenes.keys().copied().collect(),
            sums,
            scenes,
        }
    }

    /// Returns the mean, and true if all scenes of the place are included; `None` for several scenes with an incomplete
    /// result.
    fn mean(&self, method: &'a str, place: &'a str, metric: usize) -> Option<(f64, bool)> {
        let sum = self.sums.get(&(method, place))?;
        if !sum.complete && sum.scenes > 1 {
            return None;
        }
        let complete = sum.complete && self.scenes.get(place) == Some(&sum.scenes);
        Some((sum.scores[metric]? / sum.scenes as f64, complete))
    }

    /// Returns the mean over the columns of all places, as in the paper's averages, and true if each of them has all
    /// its scenes. A place of many scenes has the same weight as any other. `None` if a result is not complete.
    fn average(&self, method: &'a str, metric: usize) -> Option<(f64, bool)> {
        let column = |place: &&'a str| {
            let is_complete = self.sums.get(&(method, *place))?.complete;
            self.mean(method, place, metric).filter(|_| is_complete)
        };
        let columns: Vec<(f64, bool)> = self.places.iter().map(column).collect::<Option<_>>()?;
        let sum: f64 = columns.iter().map(|(mean, _)| mean).sum();
        let complete = columns.iter().all(|(_, complete)| *complete);
        Some((sum / columns.len() as f64, complete))
    }
}

/// Returns the methods by class, then by their average of the first metric, complete ones first.
fn in_order<'g, 'a>(
    group: &'g Group<'a>,
    means: &PlaceMeans<'a>,
    metrics: &[usize],
) -> Vec<&'g MethodRow<'a>> {
    let direction = group.quantities[metrics[0]].1;
    let mut methods = main_methods(group);
    methods.sort_by(|a, b| {
        let [left, right] = [a, b].map(|method| means.average(method.method, 0));
        let is_complete = |average: Option<(f64, bool)>| average.is_some_and(|(_, all)| all);
        let score = |average: Option<(f64, bool)>| average.map(|(mean, _)| mean);
        (a.class.cmp(&b.class))
            .then(is_complete(right).cmp(&is_complete(left)))
            .then_with(|| better_first(direction, score(left), score(right)))
    });
    methods
}

fn table<'a>(
    group: &Group<'a>,
    papers: &[Paper],
    layout: &PlaceLayout,
    title: String,
    metrics: &[usize],
    means: &PlaceMeans<'a>,
    places: &[&'a str],
) -> Table {
    let with_average = layout.with_average;
    let mut columns = Vec::new();
    if with_average {
        columns.push(column("Avg.", ColumnContent::Average));
    }
    let place_columns = places
        .iter()
        .map(|place| column(place, ColumnContent::Place((*place).to_owned())));
    columns.extend(place_columns);
    let methods = in_order(group, means, metrics);
    let mut rows = Vec::new();
    for method in &methods {
        for (position, &index) in metrics.iter().enumerate() {
            rows.push(row(
                group,
                method,
                with_average,
                (position, index),
                means,
                places,
            ));
        }
    }
    for (position, &index) in metrics.iter().enumerate() {
        let directions = vec![Some(group.quantities[index].1); columns.len()];
        mark(
            &mut rows,
            position,
            metrics.len(),
            &directions,
            &methods,
            means,
            places,
            with_average,
        );
    }
    let mut notes = common_notes(group, "video");
    notes.push(
        "A column is the mean over the scenes cut from one video, the average that of the columns; a \
         method competes in a column where it has complete results of all of them."
            .to_owned(),
    );
    notes.extend(left_out(group));
    let names = if with_average { 2 } else { 1 };
    let published = published_rows(papers, &layout.published, group.protocol, &columns, names);
    notes.extend(published.notes);
    let mut headings = vec!["Method".to_owned()];
    if with_average {
        headings.push("Metric".to_owned());
    }
    Table {
        title,
        names: headings,
        columns,
        rows,
        published: published.blocks,
        notes,
    }
}

fn column(name: &str, holds: ColumnContent) -> Column {
    Column {
        group: None,
        name: name.to_owned(),
        direction: None,
        holds,
        missing: None,
    }
}

fn row<'a>(
    group: &Group<'a>,
    method: &MethodRow<'a>,
    with_average: bool,
    (position, index): (usize, usize),
    means: &PlaceMeans<'a>,
    places: &[&'a str],
) -> Row {
    let (quantity, direction) = &group.quantities[index];
    let mut names = vec![method.method.to_owned()];
    let mut cells = Vec::new();
    if with_average {
        let metric = format::metric_title(&quantity.metric);
        names.push(format!("{metric} {}", format::arrow(*direction)));
        let average = means.average(method.method, position);
        cells.push(Cell::score(
            average.map(|(mean, _)| mean),
            &quantity.metric,
            None,
        ));
    }
    cells.extend(places.iter().map(|place| {
        let mean = means.mean(method.method, place, position);
        Cell::score(mean.map(|(mean, _)| mean), &quantity.metric, None)
    }));
    Row {
        names,
        cells,
        class: Some(method.class),
        failures: method.numbers.failures,
        marks: Mark::of(&method.numbers),
    }
}

/// Marks the best of one metric in every class, column by column: methods may be complete in only some places.
#[expect(
    clippy::too_many_arguments,
    reason = "one step of `table`, which has them all at hand"
)]
fn mark<'a>(
    rows: &mut [Row],
    position: usize,
    metrics: usize,
    directions: &[Option<Direction>],
    methods: &[&MethodRow<'a>],
    means: &PlaceMeans<'a>,
    places: &[&'a str],
    with_average: bool,
) {
    let leading = usize::from(with_average);
    let classes: BTreeSet<MethodClass> = methods.iter().map(|method| method.class).collect();
    let is_complete = |mean: Option<(f64, bool)>| mean.is_some_and(|(_, complete)| complete);
    for column in 0..directions.len() {
        let competes = |method: &MethodRow<'a>| match column.checked_sub(leading) {
            None => is_complete(means.average(method.method, position)),
            Some(place) => is_complete(means.mean(method.method, places[place], position)),
        };
        let alone: Vec<Option<Direction>> = (0..directions.len())
            .map(|other| directions[other].filter(|_| other == column))
            .collect();
        for &class in &classes {
            let of_metric = rows.iter_mut().skip(position).step_by(metrics);
            let rivals = methods.iter();
            let rivals = rivals.map(|method| method.class == class && competes(method));
            mark_standings(of_metric.zip(rivals), &alone);
        }
    }
}
