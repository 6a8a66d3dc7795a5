//! Errors of this crate.

use omnilife_schemas::{Classified, ErrorKind};

use crate::device::GpuError;

/// Errors of this crate; messages are one line.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The requested backend cannot do the work.
    #[error("{reason}")]
    Backend {
        /// Reason.
        reason: String,
    },
    /// A loss was not finite.
    #[error("diverged at iteration {iteration}: {what}")]
    Diverged {
        /// Iteration of the first value that was not finite.
        iteration: u64,
        /// Name of that value.
        what: String,
    },
}

impl Classified for EngineError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Gpu(error) => error.error_kind(),
            Self::Backend { .. } => ErrorKind::User,
            Self::Diverged { .. } => ErrorKind::Internal,
        }
    }
}
