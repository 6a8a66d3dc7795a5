//! Queries on the tables: means by any columns, of scores that may be averaged.
//!
//! Scores of different protocols, methods, kinds of view, regions or metrics are never averaged: each row of an answer
//! has one of each. Within a row every view of a result has the same weight, then every repetition on a scene, then
//! every scene, as in the tables of a leaderboard.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::{plain_text, records::Direction};
use polars::prelude::{
    Column as PolarsColumn, DataFrame, DataType, Expr, IntoLazy, LazyFrame, SortMultipleOptions,
    col, lit,
};
use rayon::prelude::*;

use crate::{
    columns::Table,
    error::ResultsError,
    filter::{self, Filter},
    frame::{self, RESULT, Selected},
    notes,
    rows::Loaded,
    source::{Source, scenes_of_other_regions},
};

/// Columns of which every row of an answer has a single value.
const ALONE: [&str; 5] = ["protocol", "protocol_hash", "view", "region", "method"];
/// Results that are read at a time.
const CHUNK: usize = 1024;
/// Column with the number of scenes on which any method of a row's group has scores.
const OF_SCENES: &str = "of_scenes";

/// A query.
#[derive(Debug, Clone)]
pub struct Query {
    /// The queried table.
    pub table: &'static Table,
    /// Columns to group by; a column of numbers may have a step, `distance_to_given:0.5`.
    pub by: Vec<String>,
    /// Metrics to average, without regions.
    pub metrics: Vec<String>,
    /// Conditions, all of which a row must meet.
    pub filters: Vec<Filter>,
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Answer {
    /// Columns of one length.
    pub columns: Vec<AnswerColumn>,
    /// Lines on omissions.
    pub notes: Vec<String>,
}

/// A column of an answer.
#[derive(Debug, Clone, PartialEq)]
pub struct AnswerColumn {
    /// Its name.
    pub name: String,
    /// Its values.
    pub values: Values,
}

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Texts.
    Text(Vec<Option<String>>),
    /// Numbers.
    Number(Vec<Option<f64>>),
    /// Whole numbers.
    Count(Vec<Option<i64>>),
    /// True or false.
    Flag(Vec<Option<bool>>),
}

impl Answer {
    /// Returns the number of its rows.
    pub fn height(&self) -> usize {
        self.columns
            .first()
            .map_or(0, |column| match &column.values {
                Values::Text(values) => values.len(),
                Values::Number(values) => values.len(),
                Values::Count(values) => values.len(),
                Values::Flag(values) => values.len(),
            })
    }
}

/// Answers a query on results.
///
/// # Errors
/// [`ResultsError::Question`] for unknown columns and metrics, and if no row remains; [`ResultsError::Store`] and
/// [`ResultsError::Impossible`] for files beside results.
pub fn ask(query: &Query, sources: &[Source<'_>]) -> Result<Answer, ResultsError> {
    let by = query
        .by
        .iter()
        .map(|text| selected(query.table, text))
        .collect::<Result<Vec<_>, _>>()?;
    let mut notes = Vec::new();
    let mut wanted = complete(query, &by, sources, &mut notes);
    mark_other_regions(&mut wanted, &mut notes);
    notes.extend(notes::missing_facts(query, &by, &wanted));
    let plan = Plan::of(query, &by)?;
    let per_result = plan.per_result(query, &wanted, &mut notes)?;
    plan.refuse_unknown_metrics(query, &per_result)?;
    let answer = plan.answer(per_result, &directions(sources, &query.metrics))?;
    notes.extend(notes::empty_cells(query.table, &plan.keys, &answer)?);
    Ok(Answer {
        columns: plan.columns(&answer)?,
        notes,
    })
}

/// Reads `COLUMN` or `COLUMN:STEP`.
fn selected(table: &Table, text: &str) -> Result<Selected, ResultsError> {
    let (name, step) = match text.split_once(':') {
        None => (text, None),
        Some((name, step)) => (name, Some(step)),
    };
    let column = filter::known(table, name.trim())?;
    let Some(step) = step else {
        return Ok(Selected { column, step: None });
    };
    let width: Option<f64> = step.trim().parse().ok();
    match width.filter(|width| *width > 0.0 && width.is_finite()) {
        Some(width) if matches!(column.kind(), "number" | "count") => Ok(Selected {
            column,
            step: Some(width),
        }),
        _ => Err(ResultsError::Question(format!(
            "{text:?}: a step is a positive number, of a column of numbers"
        ))),
    }
}

/// Key of repetitions: protocol, scene and method.
type Repetitions<'a> = (&'a str, &'a str, &'a str);

/// Returns the results for a query: complete ones, unless it has a condition on that. Of a method on a scene all
/// repetitions count or none, as in the tables of a leaderboard.
fn complete<'a>(
    query: &Query,
    by: &[Selected],
    sources: &[Source<'a>],
    notes: &mut Vec<String>,
) -> Vec<Source<'a>> {
    let filters = query.filters.iter().map(|filter| filter.column);
    let mut asked = by.iter().map(|selected| selected.column).chain(filters);
    if asked.any(|column| column.name == "complete") {
        return sources.to_vec();
    }
    let repetitions = |source: &Source<'a>| -> Repetitions<'a> {
        let result = source.result;
        (&result.protocol_hash, &result.scene, &result.method)
    };
    let incomplete: BTreeSet<Repetitions<'_>> = sources
        .iter()
        .filter(|source| !source.result.is_complete())
        .map(repetitions)
        .collect();
    let complete = sources
        .iter()
        .filter(|source| !incomplete.contains(&repetitions(source)));
    let complete: Vec<Source<'a>> = complete.cloned().collect();
    if complete.len() < sources.len() {
        let (left_out, all) = (sources.len() - complete.len(), sources.len());
        notes.push(format!(
            "{left_out} of {all} results are incomplete, or repetitions of incomplete ones, and left out"
        ));
    }
    complete
}

/// Marks results of scenes that methods were scored on with other regions: their scores by region do not compare.
fn mark_other_regions(sources: &mut [Source<'_>], notes: &mut Vec<String>) {
    let differ = scenes_of_other_regions(sources.iter().map(|source| source.result));
    for source in sources {
        let result = source.result;
        let scene = (result.protocol_hash.as_str(), result.scene.as_str());
        source.has_other_regions = differ.contains(&scene);
    }
    let scenes: BTreeSet<&str> = differ.iter().map(|(_, scene)| *scene).collect();
    if !scenes.is_empty() {
        let scenes: Vec<String> = scenes.into_iter().map(str::to_owned).collect();
        notes.push(format!(
            "static and dynamic scores of {} are left out: methods were scored with other tracks",
            plain_text::first_of(&scenes)
        ));
    }
}

/// Returns the direction of every metric, that of novel views if both kinds have it.
fn directions(sources: &[Source<'_>], metrics: &[String]) -> BTreeMap<String, Direction> {
    let mut found = BTreeMap::new();
    for metric in metrics {
        let summaries = sources.iter().flat_map(|source| {
            let result = source.result;
            [&result.novel_views, &result.input_views]
                .into_iter()
                .filter_map(|views| views.get(metric))
        });
        let mut directions = summaries.filter_map(|summary| summary.direction);
        if let Some(direction) = directions.next() {
            found.insert(metric.clone(), direction);
        }
    }
    found
}

/// Columns of the steps from rows to an answer.
struct Plan {
    /// Columns that distinguish rows of the answer, in its order.
    keys: Vec<Selected>,
    metrics: Vec<String>,
}

impl Plan {
    fn of(query: &Query, by: &[Selected]) -> Result<Self, ResultsError> {
        let plain = |name: &&str| {
            filter::known(query.table, name).map(|column| Selected { column, step: None })
        };
        let (method, others) = (ALONE[4], &ALONE[..4]);
        let always = others.iter().chain(query.table.always).map(plain);
        let mut keys: Vec<Selected> = Vec::new();
        let leading = always.collect::<Result<Vec<_>, _>>()?;
        for key in leading.into_iter().chain(by.iter().copied()) {
            let own = ["metric", "value"].contains(&key.column.name);
            if own {
                let name = key.column.name;
                return Err(ResultsError::Question(format!(
                    "{name} is what is averaged; --metric names metrics"
                )));
            }
            if key.column.name != method && !keys.iter().any(|other| is_same(other, &key)) {
                keys.retain(|other| other.column.name != key.column.name);
                keys.push(key);
            }
        }
        keys.push(plain(&method)?);
        let mut metrics: Vec<String> = Vec::new();
        for metric in query.metrics.iter().map(|metric| metric.trim()) {
            if !metrics.iter().any(|known| known == metric) {
                metrics.push(metric.to_owned());
            }
        }
        Ok(Self { keys, metrics })
    }

    fn key_columns(&self) -> Vec<Expr> {
        self.keys.iter().map(|key| col(key.column.name)).collect()
    }

    /// Means over the views of every result, by the keys.
    fn per_result(
        &self,
        query: &Query,
        sources: &[Source<'_>],
        notes: &mut Vec<String>,
    ) -> Result<DataFrame, ResultsError> {
        let mut selected = self.keys.clone();
        for name in ["scene", "metric", "value"] {
            let column = filter::known(query.table, name)?;
            if !selected.iter().any(|other| other.column.name == name) {
                selected.push(Selected { column, step: None });
            }
        }
        let chunks: Vec<(usize, DataFrame)> = sources
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(number, chunk)| {
                let loaded: Vec<Loaded<'_>> = chunk
                    .iter()
                    .map(|source| Loaded::read(source, query.table.beside))
                    .collect::<Result<_, _>>()?;
                let bare = loaded
                    .iter()
                    .filter(|loaded| !loaded.has(query.table.beside));
                let bare = bare.count();
                let rows = frame::frame(
                    query.table,
                    &loaded,
                    number * CHUNK,
                    &selected,
                    &query.filters,
                )?;
                let mut by = self.key_columns();
                by.extend(["scene", "metric", RESULT].map(col));
                by.dedup();
                let means = rows
                    .lazy()
                    .group_by_stable(unique(by))
                    .agg([col("value").mean()]);
                Ok((bare, means.collect()?))
            })
            .collect::<Result<_, ResultsError>>()?;
        let bare: usize = chunks.iter().map(|(bare, _)| bare).sum();
        if bare > 0 {
            let (file, all) = (query.table.beside.file(), sources.len());
            notes.push(format!(
                "{bare} of {all} results have no {file} beside them and are left out"
            ));
        }
        let mut all: Option<DataFrame> = None;
        for (_, chunk) in chunks {
            match &mut all {
                None => all = Some(chunk),
                Some(all) => drop(all.vstack_mut(&chunk)?),
            }
        }
        all.filter(|all| all.height() > 0).ok_or_else(|| {
            let conditions: Vec<&str> = query.filters.iter().map(Filter::text).collect();
            let known = notes.iter().map(|note| format!("; {note}"));
            ResultsError::Question(format!(
                "none of {} results has a row in {}{}{}",
                sources.len(),
                query.table.name,
                match conditions.is_empty() {
                    true => String::new(),
                    false => format!(" that meets {}", conditions.join(" and ")),
                },
                known.collect::<String>()
            ))
        })
    }

    fn refuse_unknown_metrics(
        &self,
        query: &Query,
        per_result: &DataFrame,
    ) -> Result<(), ResultsError> {
        let found: BTreeSet<&str> = per_result
            .column("metric")?
            .str()?
            .iter()
            .flatten()
            .collect();
        match self
            .metrics
            .iter()
            .find(|metric| !found.contains(metric.as_str()))
        {
            None => Ok(()),
            Some(unknown) => Err(ResultsError::Question(format!(
                "no row of {} that meets the conditions has the metric {unknown:?}; there are {} (regions are a \
                 column: --where region=static)",
                query.table.name,
                found.into_iter().collect::<Vec<_>>().join(", ")
            ))),
        }
    }

    /// Means over repetitions, then over scenes; one row per group, one column per metric.
    fn answer(
        &self,
        per_result: DataFrame,
        directions: &BTreeMap<String, Direction>,
    ) -> Result<DataFrame, ResultsError> {
        let wanted = self.metrics.iter().map(|metric| is_metric(metric));
        let wanted = wanted.reduce(Expr::or).unwrap_or_else(|| lit(false));
        let per_result = per_result.lazy().filter(wanted);
        let mut by = self.key_columns();
        by.extend(["scene", "metric"].map(col));
        let per_scene = per_result
            .group_by_stable(unique(by))
            .agg([col("value").mean()]);
        let rivals: Vec<Expr> = (self.keys.iter())
            .map(|key| key.column.name)
            .filter(|&name| name != ALONE[4])
            .map(col)
            .collect();
        let mut values: Vec<Expr> = Vec::new();
        for metric in &self.metrics {
            let of_metric = |column: &str| col(column).filter(is_metric(metric));
            let [mean, deviation, scenes] = columns_of(metric);
            values.push(of_metric("value").mean().alias(mean));
            values.push(of_metric("value").std(1).alias(deviation));
            values.push(of_metric("scene").n_unique().alias(scenes));
        }
        values.push(col(OF_SCENES).first());
        let answer = per_scene
            .with_column(col("scene").n_unique().over(rivals)?.alias(OF_SCENES))
            .group_by_stable(self.key_columns())
            .agg(values);
        self.sorted(answer, directions)
    }

    /// Sorts by the keys, and methods of equal keys by the first metric, the best first.
    fn sorted(
        &self,
        answer: LazyFrame,
        directions: &BTreeMap<String, Direction>,
    ) -> Result<DataFrame, ResultsError> {
        let mut columns: Vec<&str> = self.keys.iter().map(|key| key.column.name).collect();
        let mut descending = vec![false; columns.len()];
        if let Some(first) = self.metrics.first() {
            let method = columns.len() - 1;
            columns.insert(method, first);
            let best_is_high = directions.get(first) != Some(&Direction::LowerIsBetter);
            descending.insert(method, best_is_high);
        }
        let options = SortMultipleOptions::default()
            .with_order_descending_multi(descending)
            .with_nulls_last(true)
            .with_maintain_order(true);
        let columns: Vec<String> = columns.into_iter().map(str::to_owned).collect();
        Ok(answer.sort(columns, options).collect()?)
    }

    fn columns(&self, answer: &DataFrame) -> Result<Vec<AnswerColumn>, ResultsError> {
        let keys = self.keys.iter().map(|key| key.column.name.to_owned());
        let metrics = self.metrics.iter().flat_map(|metric| columns_of(metric));
        keys.chain(metrics)
            .chain([OF_SCENES.to_owned()])
            .map(|name| {
                let values = values(answer.column(&name)?)?;
                Ok(AnswerColumn { name, values })
            })
            .collect()
    }
}

fn is_same(a: &Selected, b: &Selected) -> bool {
    a.column.name == b.column.name && a.step == b.step
}

fn is_metric(metric: &str) -> Expr {
    col("metric").eq(lit(metric.to_owned()))
}

/// Returns the names of the columns of a metric: its mean, standard deviation over scenes, and the number of scenes.
fn columns_of(metric: &str) -> [String; 3] {
    [
        metric.to_owned(),
        format!("{metric}_sd"),
        format!("{metric}_scenes"),
    ]
}

/// Leaves out duplicate columns.
fn unique(columns: Vec<Expr>) -> Vec<Expr> {
    let mut unique: Vec<Expr> = Vec::new();
    for column in columns {
        if !unique.contains(&column) {
            unique.push(column);
        }
    }
    unique
}

fn values(column: &PolarsColumn) -> Result<Values, ResultsError> {
    Ok(match column.dtype() {
        DataType::String => {
            let texts = column.str()?.iter();
            Values::Text(texts.map(|text| text.map(str::to_owned)).collect())
        }
        DataType::Boolean => Values::Flag(column.bool()?.iter().collect()),
        DataType::Float64 => Values::Number(column.f64()?.iter().collect()),
        _ => Values::Count(column.cast(&DataType::Int64)?.i64()?.iter().collect()),
    })
}
