//! The tables of papers whose rows stand beside measured ones, as data.
//!
//! `published/*.json` holds them as printed, or with a row for each sequence and method. They are never ranked with
//! measured scores. `anchors.json` is a collection: figures of several sources for public datasets, each table with
//! its source.

mod comparison;

use serde::Deserialize;

pub(crate) use comparison::{
    ANCHORS, NEURAL_ATLAS_GRAPHS, NOT_COMPARABLE, OMNILIFE360, PublishedLayout, UAV_URBAN,
    published_rows,
};

use crate::error::LeaderboardError;

/// The embedded files with their names.
const FILES: [(&str, &str); 5] = [
    (
        "omnilife360.json",
        include_str!("../../published/omnilife360.json"),
    ),
    ("panogs.json", include_str!("../../published/panogs.json")),
    ("anchors.json", include_str!("../../published/anchors.json")),
    (
        "neural-atlas-graphs.json",
        include_str!("../../published/neural-atlas-graphs.json"),
    ),
    (
        "uav-urban.json",
        include_str!("../../published/uav-urban.json"),
    ),
];

/// The tables of one paper.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paper {
    /// Id, also the name of its file.
    pub id: String,
    /// Title.
    pub title: String,
    /// Name of the paper's own method, if its tables call it `Ours`.
    #[serde(default)]
    pub own_method: Option<String>,
    /// Those of its tables that are shown, in order.
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
    /// Address of the figures and how they were read, for a table of a collection of sources. None for a table of the
    /// paper itself.
    #[serde(default)]
    pub source: Option<String>,
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
    /// One cell per column.
    pub cells: Vec<PublishedCell>,
    /// Quantity of its numbers, if the columns do not state it.
    pub of: Option<PublishedQuantity>,
}

/// Quantity of a number.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedQuantity {
    /// Metric, by its name in the field, or by its id where the paper or its code tells the variant.
    pub metric: String,
    /// Digits after the point, as printed.
    pub decimals: usize,
}

/// A cell.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PublishedCell {
    /// A number.
    Number(f64),
    /// A number and its standard deviation.
    Deviating([f64; 2]),
    /// Words.
    Text(String),
}

impl PublishedCell {
    /// The number.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(value) | Self::Deviating([value, _]) => Some(*value),
            Self::Text(_) => None,
        }
    }

    /// Returns the words.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            Self::Number(_) | Self::Deviating(_) => None,
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

    /// Returns the printed digits after the point of the number in a cell.
    pub(crate) fn decimals(&self, row: &PublishedRow, column: usize) -> usize {
        self.quantity(row, column).map_or(3, |of| of.decimals)
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

/// All papers.
///
/// # Errors
/// When an embedded file is invalid, which a test rules out.
pub fn papers() -> Result<Vec<Paper>, LeaderboardError> {
    FILES
        .into_iter()
        .map(|(file, text)| {
            serde_json::from_str(text).map_err(|error| LeaderboardError::Published {
                file,
                reason: error.to_string(),
            })
        })
        .collect()
}
