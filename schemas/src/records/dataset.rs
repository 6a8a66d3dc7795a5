//! `dataset`: the sequences cut from a set of videos, and every video that gave none.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::CheckOutcome;
use crate::store::Record;

/// `dataset.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Dataset {
    /// One entry per input video, in the order given.
    pub videos: Vec<VideoEntry>,
}

impl Record for Dataset {
    const SCHEMA: &'static str = "omnilife/dataset/1";
}

/// What became of one video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VideoEntry {
    /// Path as given on the command line.
    pub file: String,
    /// SHA-256, where the file could be read.
    pub sha256: Option<String>,
    /// Length in seconds: of its frames where they were decoded, else as its header states it.
    pub duration_seconds: Option<f64>,
    /// Outcome.
    pub status: VideoStatus,
}

/// Outcome of curating one video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "outcome")]
pub enum VideoStatus {
    /// Its turn has not come.
    Pending,
    /// Sequences were cut from it.
    Curated {
        /// Folders of the sequences relative to the dataset, in order of time.
        sequences: Vec<String>,
    },
    /// It failed the admission criteria in force, or is not monoscopic ERP.
    Rejected {
        /// One line: the check, the value, the threshold.
        reason: String,
        /// Every check that it failed; the first one counts.
        failed: Vec<CheckOutcome>,
    },
    /// Its content is that of a video before it.
    Duplicate {
        /// That video's path as given on the command line.
        of: String,
    },
    /// It could not be read or processed.
    Failed {
        /// One line.
        reason: String,
    },
}
