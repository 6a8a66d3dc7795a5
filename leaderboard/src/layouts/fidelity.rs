//! Tables of input views, each score beside its deviation between frames. Layouts choose the scores and name the
//! published tables, whose rows stand apart.

use std::collections::BTreeSet;

use omnilife_schemas::records::{Direction, ObjectClass, ResultRecord};

use super::{best_first, main_methods, mark_notes, remarks_of, standings};
use crate::{
    class::MethodClass,
    format::{decimals, metric_title},
    group::{Group, SceneRow},
    published::{NOT_COMPARABLE, Paper, PublishedCell, PublishedLayout, PublishedTable},
    quantity::ViewKind,
    table::{Cell, Column, Mark, PublishedBlock, Row, Score, ScoreRank, Table, mark_standings},
};

/// A table of input views.
pub(super) struct FidelityLayout {
    /// Its content, the beginning of its title.
    pub(super) title: &'static str,
    pub(super) measures: &'static [Measure],
    /// Its counterparts in papers, of one protocol.
    pub(super) published: &'static [PublishedLayout],
    /// A line on its scores.
    pub(super) note: &'static str,
}

/// A score of a result.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measure {
    /// Objects that it is of; `None` for whole images.
    pub(super) class: Option<ObjectClass>,
    pub(super) metric: &'static str,
    /// Direction of better scores.
    pub(super) direction: Option<Direction>,
    /// Reason why nothing here has it; a score without a reason has a column where any result has it.
    pub(super) never: Option<&'static str>,
}

/// A score and its deviation between frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Value {
    pub(super) mean: f64,
    pub(super) deviation: Option<f64>,
}

impl Measure {
    /// Returns a score of whole images.
    pub(super) const fn of_images(metric: &'static str, direction: Option<Direction>) -> Self {
        Self {
            class: None,
            metric,
            direction,
            never: None,
        }
    }

    /// Returns a score of the objects of a class, better when higher.
    pub(super) const fn of_objects(class: ObjectClass, metric: &'static str) -> Self {
        Self {
            class: Some(class),
            metric,
            direction: Some(Direction::HigherIsBetter),
            never: None,
        }
    }

    /// Returns the heading over its columns: the class, as the papers name it.
    pub(super) fn group(self) -> Option<&'static str> {
        self.class.map(|class| match class {
            ObjectClass::Vehicle => "Vehicle",
            ObjectClass::Person => "Human",
            ObjectClass::Other => "Other",
        })
    }

    fn of_result(self, result: &ResultRecord) -> Option<Value> {
        let scores = ViewKind::Input.scores(result);
        let Some(class) = self.class else {
            let summary = scores.get(self.metric)?;
            return Some(Value {
                mean: summary.mean,
                deviation: summary.standard_deviation,
            });
        };
        let objects = result.objects.as_ref();
        let objects = objects.filter(|_| result.run_failure.is_none())?;
        let summary = objects.of_class(ViewKind::Input.name(), class, self.metric)?;
        Some(Value {
            mean: summary.mean,
            deviation: summary.standard_deviation,
        })
    }

    /// Returns the mean over the repetitions on a scene.
    pub(super) fn of_row(self, row: &SceneRow<'_>) -> Option<Value> {
        let values = row.results.iter().map(|result| self.of_result(result));
        mean(&values.collect::<Option<Vec<_>>>()?)
    }

    /// Returns the mean over the scenes in which any method has the score: some show no object of the class. `None`
    /// for a method that lacks one of them, or a result of it for the whole protocol.
    pub(super) fn of_method(self, group: &Group<'_>, method: &str) -> Option<Value> {
        let has_it = group.scene_rows.iter();
        let has_it = has_it.filter(|row| self.of_row(row).is_some());
        let scenes: BTreeSet<&str> = has_it.map(|row| row.scene).collect();
        let rows = group.rows_of(method);
        let rows: Vec<_> = rows.filter(|row| scenes.contains(row.scene)).collect();
        if rows.len() < scenes.len() || rows.iter().any(|row| !row.numbers.are_whole()) {
            return None;
        }
        let values = rows.into_iter().map(|row| self.of_row(row));
        mean(&values.collect::<Option<Vec<_>>>()?)
    }
}

/// Returns the means of scores and of their deviations; no deviation if one is missing.
fn mean(values: &[Value]) -> Option<Value> {
    let count = values.len() as f64;
    let deviations: Option<f64> = values.iter().map(|value| value.deviation).sum();
    (!values.is_empty()).then(|| Value {
        mean: values.iter().map(|value| value.mean).sum::<f64>() / count,
        deviation: deviations.map(|sum| sum / count),
    })
}

/// Returns one table by sequence and method, then the means over sequences; none for another protocol, or without any
/// of the scores.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper], layout: &FidelityLayout) -> Vec<Table> {
    let measures = measured(group, layout);
    if measures.is_empty() {
        return Vec::new();
    }
    let classes: BTreeSet<MethodClass> = group.scene_rows.iter().map(|row| row.class).collect();
    let rows = classes.into_iter();
    let rows = rows.flat_map(|class| rows_of_class(group, &measures, class));
    vec![Table {
        title: format!("{}, protocol {}", layout.title, group.protocol),
        names: ["Sequence", "Method"].map(str::to_owned).to_vec(),
        columns: columns(&measures),
        rows: rows.collect(),
        published: published(papers, layout.published, &measures, 2),
        notes: notes(group, layout.note),
    }]
}

/// Returns the scores of a layout that have columns; none for another protocol or without any results of them.
pub(super) fn measured(group: &Group<'_>, layout: &FidelityLayout) -> Vec<Measure> {
    let is_of = layout.published.iter().any(|one| one.is_of(group.protocol));
    let has = |measure: &Measure| {
        let mut rows = group.scene_rows.iter();
        rows.any(|row| measure.of_row(row).is_some())
    };
    if !is_of || !layout.measures.iter().any(has) {
        return Vec::new();
    }
    let kept = layout.measures.iter().copied();
    kept.filter(|measure| measure.never.is_some() || has(measure))
        .collect()
}

/// Returns two columns of each score, the second one of its deviation.
pub(super) fn columns(measures: &[Measure]) -> Vec<Column> {
    let of = |measure: &Measure| {
        let group = measure.group().map(str::to_owned);
        let missing = measure.never.map(str::to_owned);
        let title = metric_title(measure.metric);
        let score = Column {
            group: group.clone(),
            direction: measure.direction,
            missing,
            ..Column::plain(&title)
        };
        let deviation = Column {
            group,
            ..Column::plain(&format!("{title} ±"))
        };
        [score, deviation]
    };
    measures.iter().flat_map(of).collect()
}

/// Returns the cells of scores, each beside its deviation.
pub(super) fn cells(values: &[(Measure, Option<Value>)]) -> Vec<Cell> {
    let of = |(measure, value): &(Measure, Option<Value>)| {
        let deviation = value.and_then(|value| value.deviation);
        [
            Cell::score(value.map(|value| value.mean), measure.metric, None),
            Cell::number(deviation, decimals(measure.metric)),
        ]
    };
    values.iter().flat_map(of).collect()
}

/// Returns the directions of the columns of scores and deviations.
pub(super) fn directions(measures: &[Measure]) -> Vec<Option<Direction>> {
    let of = |measure: &Measure| [measure.direction, None];
    measures.iter().flat_map(of).collect()
}

fn rows_of_class(group: &Group<'_>, measures: &[Measure], class: MethodClass) -> Vec<Row> {
    let main: BTreeSet<&str> = main_methods(group).iter().map(|one| one.method).collect();
    let directions = directions(measures);
    let best_first = best_first(group);
    let mut rows = Vec::new();
    for scene in &group.scenes {
        let of_scene = group.rows_in(scene).iter();
        let is_shown = |row: &&SceneRow<'_>| row.class == class && main.contains(row.method);
        let mut of_scene: Vec<&SceneRow<'_>> = of_scene.filter(is_shown).collect();
        of_scene.sort_by(|a, b| best_first(&a.numbers, &b.numbers));
        let mut contest: Vec<Row> = (of_scene.iter())
            .map(|row| {
                let values = measures.iter().map(|one| (*one, one.of_row(row)));
                Row {
                    names: [row.scene, row.method].map(str::to_owned).to_vec(),
                    cells: cells(&values.collect::<Vec<_>>()),
                    class: Some(class),
                    failures: row.numbers.failures,
                    marks: Mark::of(&row.numbers),
                }
            })
            .collect();
        let complete = of_scene.iter().map(|row| row.numbers.are_whole());
        mark_standings(contest.iter_mut().zip(complete), &directions);
        rows.extend(contest);
    }
    if group.scenes.len() > 1 {
        rows.extend(rows_of_means(group, measures, class));
    }
    rows
}

fn rows_of_means(group: &Group<'_>, measures: &[Measure], class: MethodClass) -> Vec<Row> {
    let methods = standings(group).into_iter();
    let methods: Vec<_> = methods.filter(|method| method.class == class).collect();
    let mut rows: Vec<Row> = (methods.iter())
        .map(|method| {
            let of_method = |one: &Measure| (*one, one.of_method(group, method.method));
            Row {
                names: vec!["Mean".to_owned(), method.method.to_owned()],
                cells: cells(&measures.iter().map(of_method).collect::<Vec<_>>()),
                class: Some(class),
                failures: method.numbers.failures,
                marks: Mark::of(&method.numbers),
            }
        })
        .collect();
    let complete = methods.iter().map(|method| method.complete);
    mark_standings(rows.iter_mut().zip(complete), &directions(measures));
    rows
}

/// Returns notes on the numbers, after facts to know before any of them.
pub(super) fn notes(group: &Group<'_>, note: &str) -> Vec<String> {
    let remarks = remarks_of(group);
    let mut notes: Vec<String> = remarks.serious().cloned().collect();
    notes.push(format!(
        "{note} ±: sample standard deviation between frames. Means are over the sequences that have the score, each \
         with the same weight, and so are their ±. Bold: best of at least two complete methods of a class."
    ));
    notes.extend(mark_notes(group));
    notes
}

/// Returns the rows of published tables in the columns of scores and deviations; `names` is the number of leading
/// columns of names.
pub(super) fn published(
    papers: &[Paper],
    layouts: &[PublishedLayout],
    measures: &[Measure],
    names: usize,
) -> Vec<PublishedBlock> {
    let mut blocks = Vec::new();
    for layout in layouts {
        let Some(paper) = papers.iter().find(|paper| paper.id == layout.paper) else {
            continue;
        };
        let tables = layout.numbers.iter();
        for table in tables.filter_map(|&number| paper.table(number)) {
            blocks.extend(block(paper, table, measures, names));
        }
    }
    blocks
}

fn block(
    paper: &Paper,
    table: &PublishedTable,
    measures: &[Measure],
    names: usize,
) -> Option<PublishedBlock> {
    // Where each score stands in the table.
    let places = measures.iter().map(|measure| {
        let mut columns = table.columns.iter();
        columns.position(|column| {
            let metric = column.of.as_ref().map(|of| of.metric.as_str());
            metric == Some(measure.metric) && column.group.as_deref() == measure.group()
        })
    });
    let places: Vec<Option<usize>> = places.collect();
    if places.iter().all(Option::is_none) {
        return None;
    }
    let rows = table.rows.iter().map(|row| Row {
        names: (row.cells.iter().take(names))
            .map(|cell| paper.name_outside(cell.text().unwrap_or_default()))
            .collect(),
        cells: (places.iter())
            .flat_map(|place| match place {
                Some(at) => printed(&row.cells[*at], table.decimals(row, *at)),
                None => [Cell::Missing, Cell::Missing],
            })
            .collect(),
        ..Row::default()
    });
    let name = paper.own_method.as_ref().unwrap_or(&paper.title);
    Some(PublishedBlock {
        source: format!(
            "Authors' figures: {name}, Table {}: {}",
            table.number, table.title
        ),
        rows: rows.collect(),
        notes: vec![format!(
            "{NOT_COMPARABLE} Sequences of one name are not the same images: the authors' are of full size."
        )],
    })
}

/// Returns the cells of a printed number and of its deviation.
fn printed(cell: &PublishedCell, decimals: usize) -> [Cell; 2] {
    let score = match cell {
        PublishedCell::Text(text) => Cell::Text(text.clone()),
        PublishedCell::Number(value) | PublishedCell::Deviating([value, _]) => Cell::Score(Score {
            value: *value,
            decimals,
            interval: None,
            standing: ScoreRank::Other,
        }),
    };
    let deviation = match cell {
        PublishedCell::Deviating([_, deviation]) => Some(*deviation),
        _ => None,
    };
    [score, Cell::number(deviation, decimals)]
}
