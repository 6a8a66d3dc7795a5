//! Errors of curation.

mod sfm;

use std::path::{Path, PathBuf};

use omnilife_networks::WeightsError;
use omnilife_schemas::{
    Classified, ErrorKind, plain_text, records::CheckOutcome, store::StoreError,
};
use omnilife_video::VideoError;

pub use sfm::SfmError;

/// An error of this crate. Messages are one line that names the file and the reason.
#[derive(Debug, thiserror::Error)]
pub enum CurateError {
    /// An unusable video, or one that could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A sound video that the admission criteria or the ERP projection exclude.
    #[error("{}: rejected: {reason}", path.display())]
    Rejected {
        /// The video.
        path: PathBuf,
        /// The check, the value, the threshold, and advice.
        reason: String,
        /// Every check that it failed, at least one.
        failed: Vec<CheckOutcome>,
    },
    /// An invalid request: a folder without videos, an output folder that belongs to another input, poses that do not
    /// fit, an unknown name.
    #[error("{}: {reason}", path.display())]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// Fault.
        reason: String,
    },
    /// Structure from motion is missing or failed.
    #[error("{0}")]
    Sfm(#[from] SfmError),
    /// The weights of a network are missing or wrong.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Curation failed in another process.
    #[error("{message}")]
    Elsewhere {
        /// The message of the error there.
        message: String,
        /// The message in the form of [`CurateError::for_records`].
        for_records: String,
        /// Kind of the error.
        kind: ErrorKind,
        /// The failed checks of a sound video that is excluded.
        failed_checks: Option<Vec<CheckOutcome>>,
    },
    /// A library failed on sound input.
    #[error("{}: {reason}", path.display())]
    Internal {
        /// The file being worked on.
        path: PathBuf,
        /// Failure.
        reason: String,
    },
}

impl CurateError {
    /// Moves the error of a file from a temporary folder to the folder that it was to become.
    pub(crate) fn in_place_of(self, temporary: &Path, folder: &Path) -> Self {
        match self {
            Self::Input { path, reason } => {
                let place = path.strip_prefix(temporary).ok();
                // A join with nothing would end in a slash.
                let place = place.map(|rest| {
                    if rest.as_os_str().is_empty() {
                        folder.to_owned()
                    } else {
                        folder.join(rest)
                    }
                });
                Self::Input {
                    path: place.unwrap_or(path),
                    reason,
                }
            }
            other => other,
        }
    }

    /// Reports that `path` is not a usable video.
    pub(crate) fn video(path: &Path, reason: impl Into<String>) -> Self {
        Self::Video(VideoError::unusable(path, reason))
    }

    /// Reports that `path` cannot be served as requested.
    pub(crate) fn input(path: &Path, reason: impl Into<String>) -> Self {
        Self::Input {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// Reports that `path` is excluded.
    pub(crate) fn rejected(
        path: &Path,
        reason: impl Into<String>,
        failed: Vec<CheckOutcome>,
    ) -> Self {
        Self::Rejected {
            path: path.to_owned(),
            reason: reason.into(),
            failed,
        }
    }

    /// Reports that a library failed while working on `path`.
    pub(crate) fn internal(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Internal {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// Returns the error in one line for records, which are published: without folders of this machine or advice to the
    /// user. For an excluded video it lists every failed check.
    pub fn for_records(&self) -> String {
        let of_file = |path: &Path, reason: &str| {
            let name = path.file_name().unwrap_or_default();
            format!("{}: {reason}", name.to_string_lossy())
        };
        let line = match self {
            Self::Video(error) => error.without_folders(),
            Self::Rejected { failed, .. } => in_words(failed),
            Self::Input { path, reason } | Self::Internal { path, reason } => of_file(path, reason),
            Self::Sfm(error) => error.to_string(),
            Self::Weights(WeightsError::Unavailable { name, .. }) => {
                format!("the weights of {name} are not there")
            }
            Self::Weights(WeightsError::Malformed { path, reason }) => of_file(path, reason),
            Self::Store(error) => error.without_folders(),
            Self::Elsewhere { for_records, .. } => for_records.clone(),
        };
        plain_text::without_folders(&line)
    }

    /// The checks that a sound but unwanted video failed.
    pub fn failed_checks(&self) -> Option<&[CheckOutcome]> {
        match self {
            Self::Rejected { failed, .. } => Some(failed),
            Self::Elsewhere { failed_checks, .. } => failed_checks.as_deref(),
            _ => None,
        }
    }
}

/// Failed checks with their values and thresholds in one line.
pub(crate) fn in_words<'a>(failed: impl IntoIterator<Item = &'a CheckOutcome>) -> String {
    let words = failed.into_iter().map(|check| {
        format!(
            "{} is {}, required: {}",
            check.check, check.value, check.threshold
        )
    });
    words.collect::<Vec<_>>().join("; ")
}

impl Classified for CurateError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Video(error) => error.error_kind(),
            Self::Rejected { .. } | Self::Input { .. } => ErrorKind::User,
            Self::Sfm(error) => error.error_kind(),
            Self::Weights(error) => error.error_kind(),
            Self::Store(error) => error.error_kind(),
            Self::Elsewhere { kind, .. } => *kind,
            Self::Internal { .. } => ErrorKind::Internal,
        }
    }
}
