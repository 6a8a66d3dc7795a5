//! `sfm`: every attempt at structure from motion on a sequence.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scene::PoseValidation;
use crate::store::Record;

/// `sfm/attempts.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SfmReport {
    /// Attempts in the order in which they ran.
    pub attempts: Vec<SfmAttempt>,
    /// Index of the attempt whose poses were taken, where one gave any.
    pub chosen: Option<usize>,
}

impl Record for SfmReport {
    const SCHEMA: &'static str = "omnilife/sfm/1";
}

/// One attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SfmAttempt {
    /// Named configuration.
    pub configuration: String,
    /// Wall-clock time, seconds.
    pub wall_seconds: f64,
    /// Models the mapper returned; the one with the most frames is looked at.
    pub models: u32,
    /// Validation of its model, if it has one.
    pub validation: Option<PoseValidation>,
    /// Why there was none, in one line.
    pub failure: Option<String>,
}
