//! `dataset`: the sequences cut from a set of videos, and every video without one.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::CheckOutcome;
use crate::store::Record;

/// `dataset.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Dataset {
    /// One entry per input video, in the order given.
    pub videos: Vec<VideoEntry>,
    /// Videos in folders that were given, which were not taken from them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_taken: Vec<InputFile>,
}

impl Record for Dataset {
    const SCHEMA: &'static str = "omnilife/dataset/1";
}

/// A file of a folder that was given.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct InputFile {
    /// Its place in the folder, with `/` between names.
    pub file: String,
    /// Why it was not taken, in words.
    pub reason: String,
}

/// Outcome of one video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VideoEntry {
    /// Name of its file, behind as many of its folders as tell it from other videos of this name (`a/x.mp4`).
    /// Datasets of older versions have the path as it was given.
    pub file: String,
    /// SHA-256, where the file could be read.
    pub sha256: Option<String>,
    /// Length in seconds: of its frames where they were decoded, else as its header states it.
    pub duration_seconds: Option<f64>,
    /// Origin, as its list of sources states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Outcome.
    pub status: VideoStatus,
}

/// Origin of a video, as its list of sources states it; unknown fields are left out.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Origin {
    /// Address at which it was published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub url: Option<String>,
    /// Name of the person who published or filmed it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uploader: Option<String>,
    /// Licence, best as an SPDX identifier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub licence: Option<String>,
    /// When it was published or filmed: a year, a month or a day of ISO 8601.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Words by which it was found or is described.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keywords: Vec<String>,
    /// Kind of origin: taken from the web, or filmed for the dataset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<OriginKind>,
}

/// Kind of a video's origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OriginKind {
    /// From the web.
    Web,
    /// Filmed for the dataset.
    OwnCapture,
}

impl OriginKind {
    /// Returns the words for pages and messages.
    pub fn words(self) -> &'static str {
        match self {
            Self::Web => "web",
            Self::OwnCapture => "own capture",
        }
    }
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
        /// One line: every failed check with its value and threshold.
        reason: String,
        /// Every check that it failed; the first one counts.
        failed: Vec<CheckOutcome>,
    },
    /// Its content is that of a video before it.
    Duplicate {
        /// That video's `file`.
        of: String,
    },
    /// It could not be read or processed.
    Failed {
        /// One line, without a place on the machine.
        reason: String,
    },
}
