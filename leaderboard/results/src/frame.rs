//! Polars frames of results: the columns and rows of a query.

use polars::prelude::{Column as PolarsColumn, DataFrame, NamedFrom, Series};

use crate::{
    columns::{Column, Getter, Table},
    error::ResultsError,
    filter::Filter,
    rows::{Loaded, Row},
};

/// A column of a frame: one of the table, its numbers in steps of `step` if given.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Selected {
    pub(crate) column: &'static Column,
    pub(crate) step: Option<f64>,
}

pub(crate) const RESULT: &str = "result_number";

/// Makes the frame of `loaded` results, the first of which has the number `first`. Its columns are
/// `selected` and [`RESULT`].
pub(crate) fn frame(
    table: &Table,
    loaded: &[Loaded<'_>],
    first: usize,
    selected: &[Selected],
    filters: &[Filter],
) -> Result<DataFrame, ResultsError> {
    let mut builders: Vec<Builder<'_>> = selected.iter().map(Builder::of).collect();
    let mut numbers: Vec<i64> = Vec::new();
    for (at, result) in loaded.iter().enumerate() {
        (table.rows)(result, &mut |row| {
            if row.compares() && filters.iter().all(|filter| filter.accepts(&row)) {
                for builder in &mut builders {
                    builder.push(&row);
                }
                numbers.push((first + at) as i64);
            }
        });
    }
    let height = numbers.len();
    let mut columns: Vec<PolarsColumn> = builders.into_iter().map(Builder::finish).collect();
    columns.push(Series::new(RESULT.into(), numbers).into());
    Ok(DataFrame::new(height, columns)?)
}

/// Returns the start of a value's step. Rounding moves no value below the start of its step.
fn step_of(value: f64, step: f64) -> f64 {
    let steps = value / step;
    let number = (steps + 4.0 * f64::EPSILON * steps.abs()).floor();
    // 6 steps of 0.1 are 0.6, and not a sum of binary approximations of 0.1.
    let begin = number * step;
    format!("{begin:.12e}").parse().unwrap_or(begin)
}

struct Builder<'a> {
    selected: Selected,
    values: ColumnBuilder<'a>,
}

enum ColumnBuilder<'a> {
    Text(Vec<Option<&'a str>>),
    Number(Vec<Option<f64>>),
    Count(Vec<Option<i64>>),
    Flag(Vec<bool>),
}

impl<'a> Builder<'a> {
    fn of(selected: &Selected) -> Self {
        let values = match (selected.column.values, selected.step) {
            (Getter::Text(_), _) => ColumnBuilder::Text(Vec::new()),
            (Getter::Number(_), _) | (Getter::Count(_), Some(_)) => {
                ColumnBuilder::Number(Vec::new())
            }
            (Getter::Count(_), None) => ColumnBuilder::Count(Vec::new()),
            (Getter::Flag(_), _) => ColumnBuilder::Flag(Vec::new()),
        };
        Self {
            selected: *selected,
            values,
        }
    }

    fn push(&mut self, row: &Row<'a>) {
        let step = self.selected.step;
        let stepped = |value: f64| step.map_or(value, |step| step_of(value, step));
        match (&mut self.values, self.selected.column.values) {
            (ColumnBuilder::Text(values), Getter::Text(get)) => values.push(get(row)),
            (ColumnBuilder::Number(values), Getter::Number(get)) => {
                values.push(get(row).map(stepped));
            }
            (ColumnBuilder::Number(values), Getter::Count(get)) => {
                values.push(get(row).map(|count| stepped(count as f64)));
            }
            (ColumnBuilder::Count(values), Getter::Count(get)) => values.push(get(row)),
            (ColumnBuilder::Flag(values), Getter::Flag(get)) => values.push(get(row)),
            (values, _) => unreachable!("a column keeps its kind, of {} rows", values.len()),
        }
    }

    fn finish(self) -> PolarsColumn {
        let name = self.selected.column.name.into();
        let series = match self.values {
            ColumnBuilder::Text(values) => Series::new(name, values),
            ColumnBuilder::Number(values) => Series::new(name, values),
            ColumnBuilder::Count(values) => Series::new(name, values),
            ColumnBuilder::Flag(values) => Series::new(name, values),
        };
        series.into()
    }
}

impl ColumnBuilder<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Number(values) => values.len(),
            Self::Count(values) => values.len(),
            Self::Flag(values) => values.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_on_an_edge_begin_their_step() {
        for tenths in -30_i32..=30 {
            let value = f64::from(tenths) / 10.0;
            assert!((step_of(value, 0.1) - value).abs() < 1e-15, "{value}");
            let inside = step_of(value + 0.05, 0.1);
            assert!((inside - value).abs() < 1e-15, "{value}: {inside}");
        }
        assert_eq!(step_of(0.61, 0.1).to_string(), "0.6");
        assert_eq!(step_of(-0.01, 0.5).to_string(), "-0.5");
    }
}
