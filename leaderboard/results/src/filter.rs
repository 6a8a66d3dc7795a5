//! Conditions on rows: `third=2,3`, `psnr` and the like are values of `metric`, `duration_seconds>=10`.

use std::cmp::Ordering;

use crate::{
    columns::{Column, Getter, Table},
    error::ResultsError,
    rows::Row,
};

/// Operators, the longer ones first: `<=` starts like `<`.
const OPERATORS: [(&str, Operator); 6] = [
    ("!=", Operator::Differs),
    ("<=", Operator::AtMost),
    (">=", Operator::AtLeast),
    ("=", Operator::Equals),
    ("<", Operator::Below),
    (">", Operator::Above),
];

/// A condition on one column. A row without a value there does not meet it.
#[derive(Debug, Clone)]
pub struct Filter {
    /// The condition as it was written.
    text: String,
    pub(crate) column: &'static Column,
    operator: Operator,
    values: Vec<Value>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Operator {
    /// To one of the values.
    Equals,
    /// From all of the values.
    Differs,
    Below,
    AtMost,
    Above,
    AtLeast,
}

#[derive(Debug, Clone, PartialEq)]
enum Value {
    Text(String),
    Number(f64),
    Flag(bool),
}

/// Returns the values of a list, as fields of CSV.
fn fields(list: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(csv::Trim::All)
        .from_reader(list.trim().as_bytes());
    let record = reader.records().next().and_then(Result::ok);
    match record {
        Some(record) => record.iter().map(str::to_owned).collect(),
        None => vec![String::new()],
    }
}

impl Filter {
    /// Reads `COLUMN=VALUE`, `COLUMN!=VALUE` (both with several values between commas; `"a, b"` is one value), or
    /// `COLUMN<VALUE` with `<`, `<=`, `>` or `>=` of a column of numbers.
    ///
    /// # Errors
    /// [`ResultsError::Question`] with the required form.
    pub fn parse(text: &str, table: &Table) -> Result<Self, ResultsError> {
        let refuse = |reason: &str| Err(ResultsError::Question(format!("{text:?}: {reason}")));
        let found = OPERATORS
            .iter()
            .filter_map(|&(sign, operator)| Some((text.find(sign)?, sign, operator)))
            .min_by_key(|&(at, sign, _)| (at, usize::MAX - sign.len()));
        let Some((at, sign, operator)) = found else {
            return refuse("expected a column, one of = != < <= > >=, and a value");
        };
        let (name, values) = (text[..at].trim(), &text[at + sign.len()..]);
        let column = known(table, name)?;
        let values: Vec<Value> = (fields(values).iter())
            .map(|value| Value::parse(value, column))
            .collect::<Result<_, _>>()?;
        let orders = !matches!(operator, Operator::Equals | Operator::Differs);
        if orders && !matches!(values.as_slice(), [Value::Number(_)]) {
            return refuse("< <= > >= take one number, of a column of numbers");
        }
        if column.name == "metric" {
            return refuse("--metric names the metrics");
        }
        Ok(Self {
            text: text.to_owned(),
            column,
            operator,
            values,
        })
    }

    /// Returns the condition as it was written.
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Returns true if a row meets the condition.
    pub(crate) fn accepts(&self, row: &Row<'_>) -> bool {
        let of_row = match self.column.values {
            Getter::Text(get) => {
                let Some(text) = get(row) else { return false };
                return self.accepts_by(|value| match value {
                    Value::Text(other) => Some(text.cmp(other)),
                    _ => None,
                });
            }
            Getter::Number(get) => get(row).map(Value::Number),
            Getter::Count(get) => get(row).map(|count| Value::Number(count as f64)),
            Getter::Flag(get) => Some(Value::Flag(get(row))),
        };
        let Some(of_row) = of_row else { return false };
        self.accepts_by(|value| match (&of_row, value) {
            (Value::Number(own), Value::Number(other)) => own.partial_cmp(other),
            (Value::Flag(own), Value::Flag(other)) => Some(own.cmp(other)),
            _ => None,
        })
    }

    fn accepts_by(&self, compare: impl Fn(&Value) -> Option<Ordering>) -> bool {
        let orders: Vec<Option<Ordering>> = self.values.iter().map(compare).collect();
        let first = orders.first().copied().flatten();
        match self.operator {
            Operator::Equals => orders.contains(&Some(Ordering::Equal)),
            Operator::Differs => !orders.contains(&Some(Ordering::Equal)),
            Operator::Below => first.is_some_and(Ordering::is_lt),
            Operator::AtMost => first.is_some_and(Ordering::is_le),
            Operator::Above => first.is_some_and(Ordering::is_gt),
            Operator::AtLeast => first.is_some_and(Ordering::is_ge),
        }
    }
}

impl Value {
    fn parse(text: &str, column: &Column) -> Result<Self, ResultsError> {
        let value = match column.values {
            Getter::Text(_) => Some(Self::Text(text.to_owned())),
            Getter::Number(_) | Getter::Count(_) => {
                let number = text.parse().ok().filter(|n: &f64| !n.is_nan());
                number.map(Self::Number)
            }
            Getter::Flag(_) => text.parse().ok().map(Self::Flag),
        };
        let kind = column.kind();
        value.ok_or_else(|| {
            let name = column.name;
            ResultsError::Question(format!("{name} is a {kind}, and {text:?} is not"))
        })
    }
}

/// Returns the column of a name.
///
/// # Errors
/// [`ResultsError::Question`] that lists the columns.
pub(crate) fn known(table: &Table, name: &str) -> Result<&'static Column, ResultsError> {
    table.column(name).ok_or_else(|| {
        let names: Vec<&str> = table.columns().map(|column| column.name).collect();
        let table = table.name;
        ResultsError::Question(format!(
            "{name:?} is not a column of {table}; there are {}",
            names.join(", ")
        ))
    })
}
