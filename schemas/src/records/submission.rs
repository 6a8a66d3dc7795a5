//! `submission`: submitted results, with facts about the method for readers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `submission.json`. Files are relative to its folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Submission {
    /// The method.
    pub card: MethodCard,
    /// Its results, sorted by scene, protocol and seed.
    pub results: Vec<SubmittedResult>,
}

impl Record for Submission {
    const SCHEMA: &'static str = "omnilife/submission/1";
}

/// Authors and machine of a method.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MethodCard {
    /// Its name in the tables, as its results have it.
    pub method: String,
    /// Its full name.
    pub title: String,
    /// Its authors.
    pub authors: Vec<String>,
    /// Address of its code, if it is public.
    pub code: Option<String>,
    /// Licence of the code, as an SPDX identifier where there is one.
    pub licence: Option<String>,
    /// Machine: processors, GPUs, memory.
    pub hardware: String,
    /// The way the method comes to its views, where the authors say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<super::TrainingKind>,
    /// Optimizer steps of a scene, where they are the same for all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u64>,
    /// Notes for readers: training data, settings, conventions.
    pub notes: Option<String>,
}

/// One result of a submission.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SubmittedResult {
    /// Folder of its files.
    pub folder: String,
    /// Id of the scene.
    pub scene: String,
    /// Id and version of the protocol.
    pub protocol: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// Random seed, where it is known.
    pub seed: Option<u64>,
    /// Folder of the predicted input views in `folder`, where there are any.
    pub input_views: Option<String>,
    /// Folder of the predicted novel views in `folder`, where there are any.
    pub novel_views: Option<String>,
    /// Everything in `folder`, sorted by name.
    pub files: Vec<SubmittedFile>,
}

/// A file of a submission.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SubmittedFile {
    /// Relative to the result's folder, with `/` between folders.
    pub file: String,
    /// Size in bytes.
    pub bytes: u64,
    /// SHA-256 of its content.
    pub sha256: String,
}

/// `verified.json`: results of a submission that were scored again when it was taken in.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Verification {
    /// Id of the method.
    pub method: String,
    /// Day of the check, UTC, `2026-11-25`.
    pub date_utc: String,
    /// Results of the submission.
    pub results: u32,
    /// Those among them whose predictions were scored again, with the same scores.
    pub scored_again: u32,
}

impl Record for Verification {
    const SCHEMA: &'static str = "omnilife/verification/1";
}

impl Verification {
    /// Returns date and share: `verified: 3 of 4 results scored again on 2026-11-25`.
    pub fn in_words(&self) -> String {
        let (again, results, date) = (self.scored_again, self.results, &self.date_utc);
        match again {
            0 => {
                format!("not verified: none of {results} results scored again, taken in on {date}")
            }
            _ => format!("verified: {again} of {results} results scored again on {date}"),
        }
    }

    /// Counts the results of another submission of the method as well.
    pub fn add(&mut self, other: &Self) {
        self.results = self.results.saturating_add(other.results);
        self.scored_again = self.scored_again.saturating_add(other.scored_again);
        if other.date_utc > self.date_utc {
            self.date_utc.clone_from(&other.date_utc);
        }
    }
}
