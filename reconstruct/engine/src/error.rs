//! Why a step, a render or a device failed.

use omnilife_schemas::{Classified, ErrorKind};

use crate::device::GpuError;

/// Errors of this crate; messages are one line.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The backend asked for cannot do the work.
    #[error("{reason}")]
    Backend {
        /// Why not.
        reason: String,
    },
    /// A loss was not finite.
    #[error("diverged at iteration {iteration}: {what}")]
    Diverged {
        /// Iteration of the first bad value.
        iteration: u64,
        /// What was not finite.
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
