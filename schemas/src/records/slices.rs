//! `slices`: outcome of every second of a video.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::{SourceVideo, TimeRange};
use crate::store::Record;

/// `slices.json`: the whole of a video, divided into segments that are kept and segments that are
/// not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Slices {
    /// The video.
    pub source: SourceVideo,
    /// From its first frame to the end of its last.
    pub range: TimeRange,
    /// In order of time, each beginning where the one before it ends.
    pub segments: Vec<Segment>,
    /// Reason for which no segment has a slice, where slices were asked for and cannot be had.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_slices: Option<String>,
}

impl Record for Slices {
    const SCHEMA: &'static str = "omnilife/slices/2";
}

/// A segment of a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Segment {
    /// Range of time.
    pub range: TimeRange,
    /// Outcome of the segment.
    #[serde(flatten)]
    pub outcome: SegmentOutcome,
}

/// Outcome of a segment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "outcome")]
pub enum SegmentOutcome {
    /// It is a sequence.
    Kept {
        /// Name of the sequence's folder.
        sequence: String,
        /// The video of the segment, where slices were asked for.
        slice: Option<SliceFile>,
    },
    /// A shot shorter than what was asked for.
    TooShort,
    /// A shot that people leave out.
    LeftOut,
    /// A shot that fails a check of single shots.
    Rejected {
        /// Id of the check: `blank`, `title-card` or `shot-projection`.
        check: String,
        /// Measured value, in the unit of the check.
        value: f64,
        /// The limit that the value is beyond.
        limit: f64,
        /// Content of the segment and meaning of the value, in words.
        reading: String,
    },
    /// The interior of a gradual transition, which belongs to no shot.
    Transition,
}

/// A video file that holds the frames of one segment and no others.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SliceFile {
    /// Relative to the record.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Frames in it.
    pub frames: u64,
    /// Method that made it.
    pub method: SliceMethod,
    /// `true` if it has sound.
    pub audio: bool,
}

/// Method that makes a slice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum SliceMethod {
    /// The packets of the source, unchanged.
    Copied,
    /// Decoded and encoded again.
    Encoded {
        /// Encoder and settings.
        encoder: String,
    },
}
