//! `masks`: dynamic masks of a sequence, and their method.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `masks.json`, beside one mask image per frame: white marks dynamic regions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Masks {
    /// Id of the sequence.
    pub sequence: String,
    /// Source of the masks: `files`, `command`, or a method such as `residual`.
    pub method: String,
    /// Settings of the method, in words.
    pub settings: String,
    /// Measured reliability of the method on labelled footage, in words with its source; absent for masks that were
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reliability: Option<String>,
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
    /// Share of the sphere that each class covers: `person`, `vehicle`, `animal` or `operator`. The masks of a class lie
    /// beside this record in `classes/CLASS/`, under the same file name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub classes: BTreeMap<String, f64>,
}
