//! Errors of a reconstruction.

use std::path::PathBuf;

use omnilife_schemas::{Classified, ErrorKind, names::UnknownName, store::StoreError};

use omnilife_engine::{EngineError, device::GpuError};

/// Errors of this crate; messages are one line.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructError {
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A scene cannot be reconstructed.
    #[error("{}: {reason}", path.display())]
    Scene {
        /// The scene, split or image.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
    /// The name of a method, component or option is unknown.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// The work does not fit into memory.
    #[error(
        "{purpose} would take {gibibytes:.1} GiB of memory, {available_gibibytes:.1} GiB are left"
    )]
    Memory {
        /// Purpose of the memory.
        purpose: String,
        /// Required memory.
        gibibytes: f64,
        /// Available memory.
        available_gibibytes: f64,
    },
    /// The process was terminated.
    #[error(
        "scene {scene}: training was interrupted at iteration {iteration}; run the same command \
         again to go on from its last checkpoint"
    )]
    Interrupted {
        /// The scene.
        scene: String,
        /// Iterations done.
        iteration: u64,
    },
    /// An invalid request.
    #[error("{reason}")]
    Request {
        /// Reason.
        reason: String,
    },
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Training went numerically wrong.
    #[error("training of {scene} diverged at iteration {iteration}: {what}")]
    Diverged {
        /// The scene.
        scene: String,
        /// Iteration of the first bad value.
        iteration: u64,
        /// The value that was not finite.
        what: String,
    },
}

impl ReconstructError {
    /// Returns the error of the engine, with the scene's name if training diverged.
    pub(crate) fn of_engine(scene: &str, error: EngineError) -> Self {
        match error {
            EngineError::Diverged { iteration, what } => Self::Diverged {
                scene: scene.to_owned(),
                iteration,
                what,
            },
            other => Self::Engine(other),
        }
    }

    /// Returns the error that a file or folder of a scene or run is not usable, with the reason.
    pub fn scene(path: &std::path::Path, reason: impl Into<String>) -> Self {
        Self::Scene {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }
}

impl From<GpuError> for ReconstructError {
    fn from(error: GpuError) -> Self {
        Self::Engine(error.into())
    }
}

impl Classified for ReconstructError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Store(error) => error.error_kind(),
            Self::Engine(error) => error.error_kind(),
            Self::Scene { .. } | Self::Unknown(_) | Self::Memory { .. } | Self::Request { .. } => {
                ErrorKind::User
            }
            Self::Diverged { .. } | Self::Interrupted { .. } => ErrorKind::Internal,
        }
    }
}
