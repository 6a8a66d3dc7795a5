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
    /// Caps around the poles that stay, or may; empty unless they were looked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub caps: Vec<OperatorCap>,
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

/// A cap around a pole that stays in the camera's frame, with its evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OperatorCap {
    /// The pole in its middle.
    pub pole: Pole,
    /// Content of the cap.
    pub kind: CapKind,
    /// Verdict on it: `found` is part of the mask, `doubtful` only if nothing else is.
    pub finding: OperatorFinding,
    /// Angle from the pole to its border, degrees.
    pub radius_degrees: f64,
    /// Mean change within a second, 8-bit levels.
    pub change_staying_levels: f64,
    /// The same if the cap had turned with the world, 8-bit levels; 0 if the camera did not turn.
    pub change_turning_levels: f64,
    /// Share of all longitudes with an edge at its border, 0 to 1; 0 of mounts, whose border is not a circle.
    pub border_share: f64,
    /// Change that it would show as a part of the world, less its own, over its area: grey levels of 255 times
    /// steradians.
    pub evidence: f64,
}

/// A pole of the camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pole {
    /// Straight up in the frame.
    Zenith,
    /// Straight down in the frame.
    Nadir,
}

/// Content of a cap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CapKind {
    /// A tripod or another mount, with detail of its own.
    Mount,
    /// A flat patch that no lens saw.
    Gap,
}
