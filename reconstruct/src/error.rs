//! Why a reconstruction could not be made.

use std::path::PathBuf;

use omnilife_schemas::{Blame, Blamed, store::StoreError};

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
        /// Why not.
        reason: String,
    },
    /// No method of this name.
    #[error("there is no method {name:?}; known: {known}")]
    UnknownMethod {
        /// The name asked for.
        name: String,
        /// All names.
        known: String,
    },
    /// Training went numerically wrong.
    #[error("training of {scene} diverged at iteration {iteration}: {what}")]
    Diverged {
        /// The scene.
        scene: String,
        /// Iteration of the first bad value.
        iteration: u64,
        /// What was not finite.
        what: String,
    },
}

impl ReconstructError {
    pub(crate) fn scene(path: &std::path::Path, reason: impl Into<String>) -> Self {
        Self::Scene {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }
}

impl Blamed for ReconstructError {
    fn blame(&self) -> Blame {
        match self {
            Self::Store(error) => error.blame(),
            Self::Scene { .. } | Self::UnknownMethod { .. } => Blame::Input,
            Self::Diverged { .. } => Blame::Ours,
        }
    }
}
