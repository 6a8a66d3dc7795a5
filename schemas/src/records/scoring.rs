//! `scoring`: settings with which a result was computed.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{provenance::Hardware, store::Record};

/// `scoring.json`, beside the `result.json` that it speaks of. What differs from one computation of
/// the same scores to the next stands here, so that equal scores are equal files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScoringRecord {
    /// SHA-256 of the `result.json`.
    pub result_sha256: String,
    /// Names and versions of the programs that scored, with the commit.
    pub versions: BTreeMap<String, String>,
    /// The machine that scored.
    pub hardware: Hardware,
    /// When scoring ended, as `2026-01-31 23:59:59 UTC`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scored_at: Option<String>,
    /// Worker threads.
    pub threads: u32,
    /// Wall-clock time of scoring, seconds.
    pub wall_seconds: f64,
    /// Highest resident memory of the process since it began, bytes, where the system tells. In a
    /// process that did more than this, that of all its work.
    pub peak_memory_bytes: Option<u64>,
}

impl Record for ScoringRecord {
    const SCHEMA: &'static str = "omnilife/scoring/1";
}
