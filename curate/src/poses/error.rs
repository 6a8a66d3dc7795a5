//! Why structure from motion fails.

use std::path::PathBuf;

use omnilife_schemas::{Classified, ErrorKind};

/// What goes wrong with structure from motion.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// There is no interpreter with pycolmap.
    #[error("structure from motion is not installed; run scripts/setup --sfm ({reason})")]
    NotInstalled {
        /// What was looked for, and what was found.
        reason: String,
    },
    /// No attempt registered two frames, and one of them did not come to its end.
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
            // As weights that were not fetched: whoever runs the program can mend it.
            Self::NotInstalled { .. } | Self::NoPoses { .. } => ErrorKind::User,
        }
    }
}
