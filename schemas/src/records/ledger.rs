//! `ledger-entry`: one line of a video's boundary ledger, `ledger.jsonl`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    boundaries::Boundary,
    sequence::{SourceVideo, TimeRange},
};
use crate::store::Record;

/// One line of `ledger.jsonl`. Lines are only ever appended; each carries the hash of the one
/// before, so that a change to an old one shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LedgerEntry {
    /// Number of the line, from 0.
    pub id: u64,
    /// SHA-256 of the line before, without its line break; empty for line 0.
    pub previous_sha256: String,
    /// Author of the line.
    pub author: Author,
    /// When, as the author states it (RFC 3339); detectors state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// Why.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Statement of the line.
    pub action: LedgerAction,
}

impl Record for LedgerEntry {
    const SCHEMA: &'static str = "omnilife/ledger-entry/1";
}

/// Author of a line of the ledger.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Author {
    /// A detector, with the beginning of the hash of its settings.
    Detector(String),
    /// A person who annotates.
    Annotator(String),
    /// A person who audits: what experts say stands above the others.
    Expert(String),
}

/// Statement of a line of the ledger. Numbers are ids of lines that proposed a boundary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LedgerAction {
    /// The first line: the video that the ledger is about.
    Open {
        /// The video.
        source: SourceVideo,
        /// Its whole time range.
        range: TimeRange,
    },
    /// There is a boundary: a prediction, an annotation, or an addition by an expert.
    Propose(Boundary),
    /// The boundary proposed by a line is accepted.
    Accept(u64),
    /// The boundary proposed by a line is rejected.
    Reject(u64),
    /// The boundary that a line proposed lies elsewhere or is of another kind; it is accepted.
    Move {
        /// The line that proposed it.
        id: u64,
        /// The corrected boundary.
        boundary: Boundary,
    },
    /// Label of a segment. Of two labels the later one counts, and an expert's above an annotator's.
    Label(SegmentLabel),
}

/// Label of a segment of a video by a person; an absent field states nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SegmentLabel {
    /// From the first frame of the segment to the end of its last.
    pub range: TimeRange,
    /// Scene category of the taxonomy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Action of the taxonomy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<String>,
    /// `true` for a seamless traversal between indoors and outdoors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traversal: Option<bool>,
    /// `true` if the segment becomes no sequence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leave_out: Option<bool>,
}

/// In which role a person speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PersonRole {
    /// One who annotates: marks boundaries and labels segments.
    Annotator,
    /// One who audits, and may also decide on what others proposed.
    #[default]
    Expert,
}

/// `decisions.json`: what a person decided on an audit page, to be merged into a ledger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AuditDecisions {
    /// The video.
    pub source_sha256: String,
    /// Name of the person.
    pub author: String,
    /// Role of the person; `expert` in files without roles.
    #[serde(default)]
    pub role: PersonRole,
    /// The decisions in the order in which they were made.
    pub decisions: Vec<AuditDecision>,
}

impl Record for AuditDecisions {
    const SCHEMA: &'static str = "omnilife/audit-decisions/1";
}

/// One decision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AuditDecision {
    /// When (RFC 3339).
    pub time: String,
    /// Why.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Decided action; never `open`.
    pub action: LedgerAction,
}
