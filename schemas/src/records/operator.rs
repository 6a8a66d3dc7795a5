//! `operator`: content that stays in the camera's frame, and its evidence.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `operator.json`: the operator, a mount or a helmet in the frames of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Operator {
    /// Id of the sequence.
    pub sequence: String,
    /// Finding for the sequence.
    pub finding: OperatorFinding,
    /// Reason of the finding, in words.
    pub reason: String,
    /// Change that content would show if it went by, less the change that it shows, over its area: grey levels of 255
    /// times steradians; 0 if not judged.
    pub evidence: f64,
    /// Share of the sphere that its mask covers, 0 to 1.
    pub share: f64,
    /// Number of compared pairs of frames.
    pub pairs: u32,
    /// Settings of the detector, in words.
    pub settings: String,
    /// Measured reliability of the detector on labelled footage, in words with its source.
    pub reliability: String,
    /// Mask of all frames, white where it is, relative to the record.
    pub mask: Option<String>,
    /// Image of it to look at, relative to the record.
    pub image: Option<String>,
}

impl Record for Operator {
    const SCHEMA: &'static str = "omnilife/operator/1";
}

/// Finding on content that stays in the camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OperatorFinding {
    /// The sequence does not tell.
    Unjudged,
    /// Nothing stays.
    Nothing,
    /// Something may stay: a person has to look at the image.
    Doubtful,
    /// It stays, and its mask ignores it.
    Found,
}
