//! Errors of this crate.

use std::path::PathBuf;

use omnilife_schemas::{Classified, ErrorKind, store::StoreError};

/// Failure to make a table of results, or to answer a query.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// A file beside a result, or a record of a dataset.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file beside a result with impossible numbers.
    #[error("{}: {reason}", path.display())]
    Impossible {
        /// The file.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// An invalid query.
    #[error("{0}")]
    Question(String),
    /// A library of tables failed on one of our tables.
    #[error("a table of results: {0}")]
    Table(String),
}

impl From<polars::error::PolarsError> for ResultsError {
    fn from(error: polars::error::PolarsError) -> Self {
        Self::Table(error.to_string())
    }
}

impl From<parquet::errors::ParquetError> for ResultsError {
    fn from(error: parquet::errors::ParquetError) -> Self {
        Self::Table(error.to_string())
    }
}

impl Classified for ResultsError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Store(error) => error.error_kind(),
            Self::Impossible { .. } | Self::Question(_) => ErrorKind::User,
            Self::Table(_) => ErrorKind::Internal,
        }
    }
}
