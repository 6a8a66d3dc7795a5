//! `stability`: outcomes of stiff and extreme cases on every backend.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `stability.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StabilityReport {
    /// Names and versions of the programs involved.
    pub versions: BTreeMap<String, String>,
    /// Time that all of it took, wall-clock seconds.
    pub wall_seconds: f64,
    /// Backends that computed, by name, in words; or the reason why one could not.
    pub backends: BTreeMap<String, String>,
    /// The parameterizations of Gaussians that were tried.
    pub parameterizations: Vec<String>,
    /// One row for each case, parameterization and backend.
    pub rows: Vec<StabilityRow>,
    /// Families of cases that get worse step by step.
    pub sweeps: Vec<StabilitySweep>,
}

impl Record for StabilityReport {
    const SCHEMA: &'static str = "omnilife/stability/2";
    const OLDER: &'static [&'static str] = &["omnilife/stability/1"];
}

/// A case on a backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StabilityRow {
    /// Id of the case.
    pub case: String,
    /// Description, in words.
    pub title: String,
    /// The parameterization of the Gaussians.
    pub parameterization: String,
    /// `cpu` or `gpu`.
    pub backend: String,
    /// Measured errors; `None` if nothing ran.
    pub measured: Option<StabilityMeasures>,
    /// Response of the code, in words.
    pub action: String,
    /// Status of the row.
    #[serde(alias = "verdict")]
    pub status: StabilityStatus,
    /// Why not, or under which limits it is.
    pub reason: String,
}

/// Outcome of a case. An error is absent where it is not finite or has nothing to be compared with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StabilityMeasures {
    /// Largest difference of a colour value from the f64 reference, in [0, 1] units.
    pub forward_error: Option<f64>,
    /// Share of the colour values that differ by more than the case's limit: those of pixels that a
    /// Gaussian's edge misses by a rounding error.
    pub forward_share: Option<f64>,
    /// Limit of `forward_error`; none where it has no limit, and in records of older versions.
    pub forward_limit: Option<f64>,
    /// Largest difference of a gradient value from the f64 reference, relative to its own size or to
    /// the typical size in its parameter array, whichever is larger.
    pub gradient_error: Option<f64>,
    /// Limit of `gradient_error`; none where it has no limit, and in records of older versions.
    pub gradient_limit: Option<f64>,
    /// `true` if every colour and every gradient value is finite.
    pub is_finite: bool,
    /// Gaussians that were drawn.
    pub drawn: u64,
    /// Gaussians that there are.
    pub gaussians: u64,
}

/// Status of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StabilityStatus {
    /// Within the limits of the case.
    Pass,
    /// Not.
    Fail,
    /// The backend or what the case is about is not there; the reason says what.
    NotRun,
}

/// A family of cases whose condition number grows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StabilitySweep {
    /// Id.
    pub id: String,
    /// Description, in words.
    pub title: String,
    /// Quantity that the condition number counts.
    pub condition: String,
    /// Limits of its points, in words; empty in records of older versions.
    #[serde(default)]
    pub limits: String,
    /// By backend and condition number.
    pub points: Vec<StabilityPoint>,
}

/// One condition number on one backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StabilityPoint {
    /// `cpu` or `gpu`.
    pub backend: String,
    /// At least 1; 1 is the easiest.
    pub condition: f64,
    /// Measured errors.
    pub measured: StabilityMeasures,
    /// Why that is not good enough, where it is not; older versions did not judge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
}
