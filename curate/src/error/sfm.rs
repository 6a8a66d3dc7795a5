//! Errors of structure from motion.

use std::path::PathBuf;

use omnilife_schemas::{Classified, ErrorKind};

/// An error of structure from motion.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// There is no interpreter with pycolmap.
    #[error("structure from motion is not installed; run scripts/setup --sfm ({reason})")]
    NotInstalled {
        /// Searched places, and the result.
        reason: String,
    },
    /// No attempt registered two frames, and one of them crashed.
    #[error("{sequence}: structure from motion broke: {reason}")]
    Broken {
        /// Id of the sequence.
        sequence: String,
        /// The failures of all attempts.
        reason: String,
    },
    /// No attempt registered two frames.
    #[error("{sequence}: structure from motion found no poses: {reason}")]
    NoPoses {
        /// Id of the sequence.
        sequence: String,
        /// The failures of all attempts.
        reason: String,
    },
    /// The interpreter could not be run.
    #[error("{}: cannot be run: {source}", python.display())]
    Run {
        /// The interpreter.
        python: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
}

impl Classified for SfmError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Broken { .. } | Self::Run { .. } => ErrorKind::Internal,
            // Like missing weights: the user can fix it.
            Self::NotInstalled { .. } | Self::NoPoses { .. } => ErrorKind::User,
        }
    }
}
