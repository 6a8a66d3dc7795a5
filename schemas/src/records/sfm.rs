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
    /// Advice for poses that are not valid, a sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub advice: Vec<String>,
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
    /// CPU time of all threads, user and system, seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_seconds: Option<f64>,
    /// Pairs of frames far apart in time that were matched because they look alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loops: Option<u32>,
    /// Models the mapper returned; the one with the most frames is looked at.
    pub models: u32,
    /// Validation of its model, if it has one.
    pub validation: Option<PoseValidation>,
    /// Judgement by tracks of all attempts that the mapper of their own road did not see; other roads may have found
    /// the same points. Nothing without a model or such tracks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<HeldOutScore>,
    /// Why there was none, in one line.
    pub failure: Option<String>,
}

/// Judgement of poses by held-out tracks: every feature is predicted from the others of its track.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeldOutScore {
    /// Features that were predicted, or could not be for want of a pose.
    pub observations: u32,
    /// Median angle between features and their predictions, degrees; nothing if none could be predicted.
    pub median_degrees: Option<f64>,
    /// Mean credit in [0, 1]: 1 without an error, falling to 0 at half a degree; 0 without a pose, or if all frames of
    /// the track are in one place.
    pub score: f64,
}
