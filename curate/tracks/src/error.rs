//! Errors of tracking and of dense stereo.

use std::path::{Path, PathBuf};

use omnilife_networks::WeightsError;
use omnilife_schemas::{Classified, ErrorKind, store::StoreError};
use omnilife_video::VideoError;

/// An error of this crate. Messages are one line that names the file and the reason.
#[derive(Debug, thiserror::Error)]
pub enum TracksError {
    /// An invalid request: a scene that cannot be measured, boxes that do not fit it, an unknown name.
    #[error("{}: {reason}", path.display())]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// Fault.
        reason: String,
    },
    /// The weights of a network are missing or wrong.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The video with overlaid tracks could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A library failed on sound input.
    #[error("{}: {reason}", path.display())]
    Internal {
        /// The file being worked on.
        path: PathBuf,
        /// Failure.
        reason: String,
    },
}

impl TracksError {
    /// `path` cannot be served as requested.
    pub(crate) fn input(path: &Path, reason: impl Into<String>) -> Self {
        Self::Input {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// A library failed while working on `path`.
    pub(crate) fn internal(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Internal {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }
}

impl Classified for TracksError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Input { .. } => ErrorKind::User,
            Self::Weights(error) => error.error_kind(),
            Self::Video(error) => error.error_kind(),
            Self::Store(error) => error.error_kind(),
            Self::Internal { .. } => ErrorKind::Internal,
        }
    }
}
