//! `masks`: dynamic masks of a sequence, and their method.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `masks.json`, beside one mask image per frame: white is what moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Masks {
    /// Id of the sequence.
    pub sequence: String,
    /// Where they come from: `files` or `residual`.
    pub method: String,
    /// Settings of the method, in words.
    pub settings: String,
    /// One entry per frame of the sequence.
    pub frames: Vec<MaskEntry>,
}

impl Record for Masks {
    const SCHEMA: &'static str = "omnilife/masks/1";
}

/// One mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MaskEntry {
    /// Image relative to the record, named as the frame.
    pub file: String,
    /// Share of the sphere that moves.
    pub dynamic_share: f64,
}
