//! Errors of splitting and scoring.

use std::path::{Path, PathBuf};

use omnilife_networks::WeightsError;
use omnilife_schemas::{Classified, ErrorKind, names::UnknownName, store::StoreError};

/// An error of this crate. Messages are one line that names the file or scene and the reason.
///
/// A prediction that cannot be scored is not an error but a row in the result's failures.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A file could not be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Weights of a network are unusable.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// No protocol or adapter of this id.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// A protocol names an unknown metric.
    #[error("protocol {protocol}: {unknown}")]
    UnknownMetric {
        /// The protocol.
        protocol: String,
        /// The name of the metric.
        unknown: UnknownName,
    },
    /// A protocol cannot be followed on a scene.
    #[error("scene {scene}: protocol {protocol} cannot be followed: {reason}")]
    Protocol {
        /// Id of the scene.
        scene: String,
        /// Id and version of the protocol.
        protocol: String,
        /// One line.
        reason: String,
    },
    /// A scene contradicts itself or its files.
    #[error("scene {scene}: {reason}")]
    Scene {
        /// Id of the scene.
        scene: String,
        /// One line.
        reason: String,
    },
    /// Two files that should belong together do not.
    #[error("{}: {reason}", path.display())]
    Mismatch {
        /// The file at fault.
        path: PathBuf,
        /// The mismatch.
        reason: String,
    },
    /// A stated fact beside predictions is impossible.
    #[error("{reason}")]
    Statement {
        /// One line.
        reason: String,
    },
    /// The request gives nothing to score.
    #[error("nothing to score: no predictions were given of views that the protocol scores")]
    NothingToScore,
    /// Two sides share no scene that both scored completely.
    #[error("{methods}: nothing to compare: {reasons}")]
    NothingToCompare {
        /// The compared methods.
        methods: String,
        /// Reasons for omissions.
        reasons: String,
    },
    /// The caller has cancelled the work.
    #[error("scoring was interrupted; run it again to start from the first view")]
    Interrupted,
    /// A metric gave a number that is not finite, or the table could not be encoded.
    #[error("{}: {reason}", path.display())]
    Internal {
        /// The file being scored or written.
        path: PathBuf,
        /// One line.
        reason: String,
    },
}

impl BenchError {
    /// Reports that `path` does not belong to the other files of the request.
    pub(crate) fn mismatch(path: &Path, reason: impl Into<String>) -> Self {
        Self::Mismatch {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// Reports a failure of this program on `path`.
    pub(crate) fn internal(path: &Path, reason: impl Into<String>) -> Self {
        Self::Internal {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }
}

impl Classified for BenchError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::Store(error) => error.error_kind(),
            Self::Weights(error) => error.error_kind(),
            Self::Interrupted | Self::Internal { .. } => ErrorKind::Internal,
            Self::Unknown(_)
            | Self::UnknownMetric { .. }
            | Self::Protocol { .. }
            | Self::Scene { .. }
            | Self::Mismatch { .. }
            | Self::Statement { .. }
            | Self::NothingToScore
            | Self::NothingToCompare { .. } => ErrorKind::User,
        }
    }
}
