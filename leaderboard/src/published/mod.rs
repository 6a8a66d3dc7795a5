//! The tables of the papers that this project implements, as data.
//!
//! `published/*.json` holds them as printed: every row names its line in the paper's text version. They are shown
//! beside measured scores and never ranked with them. `published/findings.json` lists consistent and inconsistent
//! numbers in them; `scripts/published-tables` checks both.

mod comparison;

use serde::{Deserialize, de::DeserializeOwned};

use omnilife_schemas::records::Direction;

pub(crate) use comparison::{NOT_COMPARABLE, PublishedLayout, published_rows};

use crate::error::LeaderboardError;

/// The embedded files with their names.
const FILES: [(&str, &str); 4] = [
    (
        "omnilife360.json",
        include_str!("../../published/omnilife360.json"),
    ),
    ("panogs.json", include_str!("../../published/panogs.json")),
    (
        "uav-urban.json",
        include_str!("../../published/uav-urban.json"),
    ),
    (
        "neural-atlas-graphs.json",
        include_str!("../../published/neural-atlas-graphs.json"),
    ),
];

const FINDINGS: &str = include_str!("../../published/findings.json");

/// The tables of one paper.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paper {
    /// Id, also the name of its file.
    pub id: String,
    /// Title.
    pub title: String,
    /// Data of its scores, as far as stated.
    pub about: String,
    /// Method that its tables call `Ours`, if any.
    #[serde(default)]
    pub own_method: Option<String>,
    /// All its tables, in order.
    pub tables: Vec<PublishedTable>,
}

/// One table as printed.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedTable {
    /// Number in the paper.
    pub number: u32,
    /// Content.
    pub title: String,
    /// Line of the caption in the paper's text version, from 1.
    pub line: usize,
    /// Notes for readers of the numbers.
    pub notes: Vec<String>,
    /// Columns from the left; the first ones hold names.
    pub columns: Vec<PublishedColumn>,
    /// Rows from the top.
    pub rows: Vec<PublishedRow>,
}

/// A column.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedColumn {
    /// Heading.
    pub name: String,
    /// Heading over several columns.
    pub group: Option<String>,
    /// Quantity of its numbers, unless the rows state it.
    pub of: Option<PublishedQuantity>,
}

/// A row.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedRow {
    /// Line in the paper's text version, from 1.
    pub line: usize,
    /// One cell per column.
    pub cells: Vec<PublishedCell>,
    /// Quantity of its numbers, if the columns do not state it.
    pub of: Option<PublishedQuantity>,
    /// Columns that are underlined (second best), counted from 0.
    #[serde(default)]
    pub underlined: Vec<usize>,
}

/// Quantity of a number.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedQuantity {
    /// Metric, by its name in the field: the papers do not tell variants apart.
    pub metric: String,
    /// `dB`, `ratio`, `distance`, `count`, `MB`, `s`, `min`.
    pub unit: String,
    /// Direction of better values, if there is one.
    pub direction: Option<Direction>,
    /// Digits after the point, as printed.
    pub decimals: usize,
}

/// A cell.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PublishedCell {
    /// A number.
    Number(f64),
    /// A mean and its standard deviation.
    Spread([f64; 2]),
    /// Words.
    Text(String),
    /// Nothing, or not applicable.
    Empty,
}

impl PublishedCell {
    /// Returns the number, without its spread.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(value) | Self::Spread([value, _]) => Some(*value),
            Self::Text(_) | Self::Empty => None,
        }
    }

    /// Returns the words.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Formats as printed, with `decimals` digits after the point.
    pub fn printed(&self, decimals: usize) -> String {
        match self {
            Self::Number(value) => format!("{value:.decimals$}"),
            Self::Spread([mean, deviation]) => {
                format!("{mean:.decimals$} ± {deviation:.decimals$}")
            }
            Self::Text(text) => text.clone(),
            Self::Empty => "–".to_owned(),
        }
    }
}

impl Paper {
    /// Returns a name of its tables for use outside of the paper: `Ours` becomes the method's name, marked as its
    /// authors' figures; so does a name with `(Ours)`.
    pub fn name_outside(&self, printed: &str) -> String {
        if let Some(name) = printed.strip_suffix(" (Ours)") {
            return format!("{name} (authors)");
        }
        match (&self.own_method, printed.strip_prefix("Ours")) {
            (Some(own), Some(rest)) => format!("{own}{rest} (authors)"),
            _ => printed.to_owned(),
        }
    }

    /// Returns a table by its number.
    pub fn table(&self, number: u32) -> Option<&PublishedTable> {
        self.tables.iter().find(|table| table.number == number)
    }
}

impl PublishedTable {
    /// Returns the quantity of the number in a cell.
    pub fn quantity<'a>(
        &'a self,
        row: &'a PublishedRow,
        column: usize,
    ) -> Option<&'a PublishedQuantity> {
        row.of.as_ref().or(self.columns[column].of.as_ref())
    }

    /// Returns the number in the row that starts with `name` and in a column counted from 0.
    pub fn number(&self, name: &str, column: usize) -> Option<f64> {
        self.row(name)?.cells.get(column)?.number()
    }

    /// Returns the first row that starts with `name`.
    pub fn row(&self, name: &str) -> Option<&PublishedRow> {
        self.rows.iter().find(|row| row.name() == name)
    }

    /// Returns a column's whole heading.
    pub fn heading(&self, column: usize) -> String {
        let column = &self.columns[column];
        match &column.group {
            Some(group) => format!("{group} {}", column.name),
            None => column.name.clone(),
        }
    }
}

impl PublishedRow {
    /// Returns the first cell.
    pub fn name(&self) -> &str {
        self.cells
            .first()
            .and_then(PublishedCell::text)
            .unwrap_or("")
    }
}

/// A check of the tables of a paper.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Finding {
    /// Id of the paper.
    pub paper: String,
    /// Place, such as `Table 4`.
    pub place: String,
    /// True if the paper is consistent here.
    pub holds: bool,
    /// Result, with the numbers.
    pub text: String,
    /// Verbatim quotations of the paper.
    pub quotes: Vec<String>,
}

/// Returns all papers.
///
/// # Errors
/// When an embedded file is invalid, which a test rules out.
pub fn papers() -> Result<Vec<Paper>, LeaderboardError> {
    FILES
        .into_iter()
        .map(|(file, text)| parsed(file, text))
        .collect()
}

/// Returns the findings about all papers, in order of the papers.
///
/// # Errors
/// Those of [`papers`].
pub fn findings() -> Result<Vec<Finding>, LeaderboardError> {
    parsed("findings.json", FINDINGS)
}

fn parsed<T: DeserializeOwned>(file: &'static str, text: &str) -> Result<T, LeaderboardError> {
    serde_json::from_str(text).map_err(|error| LeaderboardError::Published {
        file,
        reason: error.to_string(),
    })
}
