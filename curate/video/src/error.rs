//! Errors of reading and writing video.

use std::{
    io,
    path::{Path, PathBuf},
};

use omnilife_schemas::{Classified, ErrorKind, store::StoreError};

/// An error of this crate. Messages are one line that names the file and the reason.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// An unusable video: not a video, truncated, corrupt.
    #[error("{}: {reason}{}", path.display(), after(*advice))]
    Unusable {
        /// The video.
        path: PathBuf,
        /// Fault.
        reason: String,
        /// Advice to the user.
        advice: Option<&'static str>,
    },
    /// A path that FFmpeg cannot write to.
    #[error("{}: {reason}", path.display())]
    Input {
        /// The path.
        path: PathBuf,
        /// Fault.
        reason: String,
    },
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

impl VideoError {
    /// `path` is not a usable video.
    pub fn unusable(path: &Path, reason: impl Into<String>) -> Self {
        Self::Unusable {
            path: path.to_owned(),
            reason: reason.into(),
            advice: None,
        }
    }

    /// `path` is not a usable video as it is.
    pub(crate) fn mendable(path: &Path, reason: impl Into<String>, advice: &'static str) -> Self {
        Self::Unusable {
            path: path.to_owned(),
            reason: reason.into(),
            advice: Some(advice),
        }
    }

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

    /// FFmpeg's writer failed on `path`: in all likelihood by the disk.
    pub fn unwritable(path: &Path, error: ffmpeg_next::Error) -> Self {
        StoreError::write(path, io::Error::other(error)).into()
    }

    /// Returns the message without the file of an unusable video, and with the name of another file alone.
    pub fn without_folders(&self) -> String {
        match self {
            Self::Unusable { reason, .. } => reason.clone(),
            Self::Input { path, reason } | Self::Internal { path, reason } => {
                let name = path.file_name().unwrap_or_default();
                format!("{}: {reason}", name.to_string_lossy())
            }
            Self::Store(error) => error.without_folders(),
        }
    }
}

/// Returns advice behind a reason.
fn after(advice: Option<&str>) -> String {
    advice.map_or_else(String::new, |advice| format!("; {advice}"))
}

impl Classified for VideoError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Unusable { .. } | Self::Input { .. } => ErrorKind::User,
            Self::Store(error) => error.error_kind(),
            Self::Internal { .. } => ErrorKind::Internal,
        }
    }
}
