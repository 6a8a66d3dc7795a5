//! What can be re-derived from the published tables, and whether it holds.
//!
//! Every finding is computed from the transcribed numbers; what the papers say in words is quoted
//! to the letter, and a test looks the quotations up where the papers are at hand.

mod neural_atlas_graphs;
mod omnilife360;
mod panogs;
mod uav_urban;

use omnilife_schemas::records::Direction;

use super::{Paper, PublishedTable};

/// One thing that was checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Id of the paper.
    pub paper: &'static str,
    /// Where, such as `Table 4`.
    pub place: String,
    /// Whether the paper is consistent here.
    pub holds: bool,
    /// What was found, with the numbers.
    pub text: String,
    /// What the paper says, to the letter.
    pub quotes: Vec<&'static str>,
}

impl Finding {
    fn new(paper: &'static str, place: impl Into<String>, holds: bool, text: String) -> Self {
        Self {
            paper,
            place: place.into(),
            holds,
            text,
            quotes: Vec::new(),
        }
    }

    fn quoting(mut self, quote: &'static str) -> Self {
        self.quotes.push(quote);
        self
    }
}

/// The checks of one paper; nothing where it lacks a table that they need.
type Check = fn(&Paper) -> Option<Vec<Finding>>;

/// Checks all papers. A table that a check asks for and that is missing shows as a missing
/// finding, which the committed report notices.
pub fn findings(papers: &[Paper]) -> Vec<Finding> {
    let checks: [(&str, Check); 4] = [
        (omnilife360::ID, omnilife360::check),
        (panogs::ID, panogs::check),
        (uav_urban::ID, uav_urban::check),
        (neural_atlas_graphs::ID, neural_atlas_graphs::check),
    ];
    checks
        .into_iter()
        .filter_map(|(id, check)| papers.iter().find(|paper| paper.id == id).and_then(check))
        .flatten()
        .collect()
}

/// Half a unit of the last digit printed.
fn half_digit(decimals: usize) -> f64 {
    0.5 * 10_f64.powi(-(decimals as i32))
}

/// Whether a printed mean can be the mean of printed values: both were rounded.
fn is_mean(printed: f64, derived: f64, decimals: usize) -> bool {
    // A billionth for the decimal fractions that binary numbers only approach.
    (printed - derived).abs() <= 2.0 * half_digit(decimals) + 1e-9
}

/// Weighted mean of `(value, weight)`.
fn weighted_mean(values: &[(f64, f64)]) -> Option<f64> {
    let weights: f64 = values.iter().map(|(_, weight)| weight).sum();
    (weights > 0.0).then(|| values.iter().map(|(v, w)| v * w).sum::<f64>() / weights)
}

/// Columns of a table in which a row that should be best is not: heading, its value, the best
/// value and who has it.
fn beaten<'a>(
    table: &'a PublishedTable,
    row_name: &str,
    columns: impl Iterator<Item = usize>,
) -> Vec<(String, f64, f64, &'a str)> {
    let Some(row) = table.row(row_name) else {
        return Vec::new();
    };
    columns
        .filter_map(|column| {
            let own = row.cells.get(column)?.number()?;
            let direction = table.quantity(row, column)?.direction?;
            let (best, who) = table
                .rows
                .iter()
                .filter_map(|rival| Some((rival.cells.get(column)?.number()?, rival.name())))
                .reduce(|best, rival| better(direction, best, rival))?;
            direction
                .prefers(best, own)
                .then(|| (table.heading(column), own, best, who))
        })
        .collect()
}

fn better<'a>(direction: Direction, left: (f64, &'a str), right: (f64, &'a str)) -> (f64, &'a str) {
    if direction.prefers(right.0, left.0) {
        right
    } else {
        left
    }
}

/// `a, b and c`.
fn listed(parts: &[String]) -> String {
    match parts {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}
