//! Errors of building a leaderboard.

use std::path::PathBuf;

use omnilife_results::ResultsError;
use omnilife_schemas::{Classified, ErrorKind, store::StoreError};

/// An error of this crate. Messages are one line that names the file and the reason.
#[derive(Debug, thiserror::Error)]
pub enum LeaderboardError {
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A table of results could not be made, or a query not be answered.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// There is nothing to build a table from.
    #[error("{}: holds no result.json", folder.display())]
    NoResults {
        /// The folder searched.
        folder: PathBuf,
    },
    /// A result holds values that no scoring can give.
    #[error("{}: {reason}", path.display())]
    Impossible {
        /// The file.
        path: PathBuf,
        /// The impossible value.
        reason: String,
    },
    /// A submission, or the input of one, is invalid.
    #[error("{}: {reason}", path.display())]
    Submission {
        /// The file or folder.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// A figure cannot be drawn.
    #[error("{}: {reason}", path.display())]
    Figure {
        /// The file or folder.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// Two results claim the same row.
    #[error(
        "{}: method {method} on scene {scene} under protocol {protocol} is also scored in {}, with \
         the same seed; a table has one row for it",
        second.display(),
        first.display()
    )]
    Duplicate {
        /// Id of the method.
        method: String,
        /// Id of the scene.
        scene: String,
        /// Id and version of the protocol.
        protocol: String,
        /// The first file, in the order of collection.
        first: PathBuf,
        /// The other file.
        second: PathBuf,
    },
    /// One scene id is used for two scenes.
    #[error(
        "{}: scene {scene} has other frames or poses than in {}; scores on them do not compare: \
         score one of them again, or give the scenes different names",
        second.display(),
        first.display()
    )]
    SceneDiffers {
        /// Id of the scene.
        scene: String,
        /// The first file, in the order of collection.
        first: PathBuf,
        /// The other file.
        second: PathBuf,
    },
    /// Two results of one protocol disagree about a metric's direction.
    #[error("{}: says that {metric} is {found}, other results say the opposite", path.display())]
    Direction {
        /// The file.
        path: PathBuf,
        /// Id of the metric.
        metric: String,
        /// The direction in the file.
        found: &'static str,
    },
    /// Checked files differ from those that the results give.
    #[error("{}: {reason}; build again without --check to bring it up to date", path.display())]
    OutOfDate {
        /// The first such file.
        path: PathBuf,
        /// The difference.
        reason: String,
    },
    /// A page has no place for the table.
    #[error("{}: has no line {marker}", path.display())]
    NoMarker {
        /// The page.
        path: PathBuf,
        /// The expected line.
        marker: &'static str,
    },
    /// A chart could not be drawn.
    #[error("chart {chart}: {reason}")]
    Chart {
        /// The chart.
        chart: String,
        /// The plotting library's reason.
        reason: String,
    },
    /// An embedded file of published tables is broken.
    #[error("published tables, {file}: {reason}")]
    Published {
        /// The file.
        file: &'static str,
        /// The fault.
        reason: String,
    },
}

impl Classified for LeaderboardError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Store(error) => error.error_kind(),
            Self::Results(error) => error.error_kind(),
            Self::NoResults { .. }
            | Self::Impossible { .. }
            | Self::Submission { .. }
            | Self::Figure { .. }
            | Self::Duplicate { .. }
            | Self::SceneDiffers { .. }
            | Self::Direction { .. }
            | Self::OutOfDate { .. }
            | Self::NoMarker { .. } => ErrorKind::User,
            Self::Chart { .. } | Self::Published { .. } => ErrorKind::Internal,
        }
    }
}
