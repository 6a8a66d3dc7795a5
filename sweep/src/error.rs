//! Errors of planning, running and submitting a sweep.

use std::path::PathBuf;

use omnilife_schemas::{Classified, ErrorKind, store::StoreError};

/// Error of this crate. Messages are one line that names the file or unit and the reason.
///
/// A failed unit is not an error but a row in the sweep's table.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The units do not make a plan.
    #[error("{reason}")]
    Plan {
        /// One line.
        reason: String,
    },
    /// The folder holds the plan of other work, or a plan that was changed.
    #[error("{}: {reason}", path.display())]
    OtherPlan {
        /// The plan.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// Unknown id of a unit.
    #[error("no unit is called {id}; `omnilife sweep status --units` lists them")]
    UnknownUnit {
        /// The id.
        id: String,
    },
    /// Another pool runs the sweep.
    #[error("{}: is run by {by} already", folder.display())]
    Busy {
        /// The sweep.
        folder: PathBuf,
        /// Its runner.
        by: String,
    },
    /// The runner was asked to end and has done so.
    #[error(
        "interrupted; run the same command again to go on, units under way from their checkpoints"
    )]
    Interrupted,
    /// A Slurm command failed.
    #[error("{command}: {reason}")]
    Slurm {
        /// The Slurm command.
        command: String,
        /// One line.
        reason: String,
    },
    /// A command of the plan's reduction failed.
    #[error("{command}: {reason}")]
    Reduce {
        /// The command.
        command: String,
        /// Its ending, and its last printed line.
        reason: String,
    },
}

impl Classified for SweepError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Store(error) => error.error_kind(),
            Self::Plan { .. }
            | Self::OtherPlan { .. }
            | Self::UnknownUnit { .. }
            | Self::Busy { .. } => ErrorKind::User,
            Self::Interrupted | Self::Slurm { .. } | Self::Reduce { .. } => ErrorKind::Internal,
        }
    }
}
