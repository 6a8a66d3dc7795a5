//! `dataset-status`: parts that every sequence of a dataset has and lacks, with the commands that make them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `status.json`, beside `dataset.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct DatasetStatus {
    /// Sequences in the dataset's order; imported scenes by their folders.
    pub sequences: Vec<SequenceStatus>,
    /// Videos without sequences, in the dataset's order.
    pub lost: Vec<LostVideo>,
}

impl Record for DatasetStatus {
    const SCHEMA: &'static str = "omnilife/dataset-status/1";
}

/// Video without sequences.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LostVideo {
    /// Its name in `dataset.json`.
    pub file: String,
    /// Outcome: `pending`, `rejected`, `duplicate` or `failed`.
    pub outcome: String,
    /// Reason in one line.
    pub reason: String,
}

/// Parts of one sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SequenceStatus {
    /// Id of the sequence.
    pub id: String,
    /// Its folder relative to the dataset, with `/` between names; `.` for the folder itself.
    pub folder: String,
    /// Length of its segment of the video in seconds; of imported scenes, from the first frame to the last.
    pub duration_seconds: f64,
    /// State of every part that it can have, in the order of [`SequencePart::ALL`].
    pub parts: Vec<PartStatus>,
}

impl SequenceStatus {
    /// Returns the state of a part; `None` where a sequence of this kind cannot have it.
    pub fn part(&self, part: SequencePart) -> Option<&PartStatus> {
        self.parts.iter().find(|status| status.part == part)
    }

    /// Returns the parts that are missing or incomplete, in their order.
    pub fn lacking(&self) -> impl Iterator<Item = &PartStatus> {
        let parts = self.parts.iter();
        parts.filter(|status| status.state != PartState::Present)
    }
}

/// State of one part of a sequence.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PartStatus {
    /// The part.
    pub part: SequencePart,
    /// Its state.
    pub state: PartState,
    /// Number of frames (of tags for annotations, of files for points and splits) that have it.
    pub count: u64,
    /// Number that a complete part has.
    pub of: u64,
    /// Remark: the method of masks, the validation of poses.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Command that makes the part, for a shell in the dataset's folder. Words in capitals stand for files to be given.
    /// Missing where the part is present, or where no command would add to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<String>,
}

/// State of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PartState {
    /// Complete.
    Present,
    /// There for some frames only, or made and not yet in the scene.
    Incomplete,
    /// Missing.
    Missing,
}

/// Part of a sequence.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum SequencePart {
    /// Images of the frames.
    Frames,
    /// Camera poses.
    Poses,
    /// World points.
    Points,
    /// Masks of moving content.
    Masks,
    /// Masks of ignored regions.
    IgnoreMasks,
    /// True distances or a depth prior.
    Depth,
    /// Tags, caption and measured motion.
    Annotation,
    /// Splits into input views and novel views.
    Splits,
}

impl SequencePart {
    /// All parts, each after those that it needs.
    pub const ALL: [Self; 8] = [
        Self::Frames,
        Self::Poses,
        Self::Points,
        Self::Masks,
        Self::IgnoreMasks,
        Self::Depth,
        Self::Annotation,
        Self::Splits,
    ];

    /// Returns the name for tables and pages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Poses => "poses",
            Self::Points => "points",
            Self::Masks => "masks",
            Self::IgnoreMasks => "ignore masks",
            Self::Depth => "depth",
            Self::Annotation => "annotation",
            Self::Splits => "splits",
        }
    }

    /// Returns true for parts that many sequences do well without: there may be no operator to ignore, and no
    /// distances.
    pub fn is_optional(self) -> bool {
        matches!(self, Self::IgnoreMasks | Self::Depth)
    }
}
