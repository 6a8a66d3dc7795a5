//! Why a leaderboard could not be built.

use std::path::PathBuf;

use omnilife_schemas::{Blame, Blamed, store::StoreError};

/// An error of this crate. Messages are one line that names the file and the reason.
#[derive(Debug, thiserror::Error)]
pub enum LeaderboardError {
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There is nothing to build a table from.
    #[error("{}: holds no result.json", folder.display())]
    NoResults {
        /// The folder searched.
        folder: PathBuf,
    },
    /// Two results claim the same row.
    #[error(
        "{}: method {method} on scene {scene} under protocol {protocol} is also scored in {}; \
         a table has one row for it",
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
    /// One scene id stands for two scenes.
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
        /// What the file says.
        found: &'static str,
    },
}

impl Blamed for LeaderboardError {
    fn blame(&self) -> Blame {
        match self {
            Self::Store(error) => error.blame(),
            Self::NoResults { .. }
            | Self::Duplicate { .. }
            | Self::SceneDiffers { .. }
            | Self::Direction { .. } => Blame::Input,
        }
    }
}
