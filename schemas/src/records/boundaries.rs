//! `boundaries`: boundaries of shots with their sources.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::{SourceVideo, TimeRange};
use crate::store::Record;

/// `boundaries.json`: the boundaries by which one video was cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BoundaryLedger {
    /// The video.
    pub source: SourceVideo,
    /// Its whole time range.
    pub range: TimeRange,
    /// Detector that proposed the boundaries and its settings.
    pub detector: String,
    /// SHA-256 of the ledger `ledger.jsonl` whose resolution the boundaries are; without one they
    /// are what the detector found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ledger_sha256: Option<String>,
    /// Boundaries in order of time.
    pub boundaries: Vec<Boundary>,
    /// Segments between boundaries that are too short to become sequences.
    pub dropped: Vec<TimeRange>,
    /// Segments between boundaries that people leave out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<TimeRange>,
    /// Segments between boundaries that fail a check of single shots.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rejected: Vec<RejectedShot>,
}

impl Record for BoundaryLedger {
    const SCHEMA: &'static str = "omnilife/boundaries/1";
}

/// A shot that becomes no sequence for what its frames show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RejectedShot {
    /// Range of time.
    pub range: TimeRange,
    /// Id of the check that it fails: `blank`, `title-card` or `shot-projection`.
    pub check: String,
    /// Measured value, in the unit of the check.
    pub value: f64,
    /// The limit that the value is beyond.
    pub limit: f64,
    /// Content of the segment and meaning of the value, in words.
    pub reading: String,
}

/// A change of shot or of place. A cut has `begin_seconds` (last frame of the old shot) and
/// `end_seconds` (first frame of the new shot) one frame apart; a gradual one spans its transition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Boundary {
    /// Timestamp of the last frame that belongs to the old shot alone.
    pub begin_seconds: f64,
    /// Timestamp of the first frame that belongs to the new shot alone.
    pub end_seconds: f64,
    /// Kind of change.
    pub kind: BoundaryKind,
    /// The detector's score, on its own scale; 1 for what people say.
    pub score: f64,
}

/// Kinds of boundary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BoundaryKind {
    /// From one frame to the next.
    Cut,
    /// Over several frames: a dissolve, fade or wipe.
    Gradual,
    /// The camera passes between indoors and outdoors with a discontinuity of light or place.
    IndoorOutdoor,
    /// The camera passes between indoors and outdoors seamlessly: marked so that it is kept whole,
    /// with whatever detectors find inside it.
    SeamlessTraversal,
}

impl BoundaryKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [
        Self::Cut,
        Self::Gradual,
        Self::IndoorOutdoor,
        Self::SeamlessTraversal,
    ];

    /// Returns the name in records and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cut => "cut",
            Self::Gradual => "gradual",
            Self::IndoorOutdoor => "indoor-outdoor",
            Self::SeamlessTraversal => "seamless-traversal",
        }
    }

    /// Returns whether a video is cut there.
    pub fn separates(self) -> bool {
        self != Self::SeamlessTraversal
    }
}
