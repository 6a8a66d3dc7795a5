//! Outcome of every video and sequence of a job.

use std::path::Path;

use omnilife_curate::CurateError;
use omnilife_schemas::{
    Classified, ErrorKind,
    plain_text::{serialize_for_spreadsheet, without_folders},
    store::{self, StoreError},
};
use serde::Serialize;

use crate::exit::{self, PartialFailure};

/// Row of the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Outcome {
    /// Name of the video in `dataset.json`.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub(crate) video: String,
    /// Id of the sequence; empty for a video without sequences.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub(crate) sequence: String,
    /// `scored`, `curated`, `failed`.
    pub(crate) outcome: &'static str,
    /// Reason of a failure in one line, without folders of this machine.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub(crate) reason: String,
    /// Reason with folders and remedy, for the terminal.
    #[serde(skip)]
    message: String,
    #[serde(skip)]
    blame: Option<ErrorKind>,
}

impl Outcome {
    pub(crate) fn scored(video: &str, sequence: &str) -> Self {
        Self {
            video: video.to_owned(),
            sequence: sequence.to_owned(),
            outcome: "scored",
            reason: String::new(),
            message: String::new(),
            blame: None,
        }
    }

    /// Makes the row of a video with sequences, where no more was requested.
    pub(crate) fn curated(video: &str) -> Self {
        Self {
            outcome: "curated",
            ..Self::scored(video, "")
        }
    }

    /// Makes the row of a sequence of the dataset in `out` that failed.
    pub(crate) fn failed(video: &str, sequence: &str, error: &anyhow::Error, out: &Path) -> Self {
        let message = error.to_string();
        let in_dataset = message.replace(&format!("{}/", out.display()), "");
        Self {
            outcome: "failed",
            reason: without_folders(&in_dataset),
            message,
            blame: Some(exit::error_kind(error)),
            ..Self::scored(video, sequence)
        }
    }

    /// Makes the row of a video that failed or was rejected.
    pub(crate) fn failed_video(video: &str, error: &CurateError) -> Self {
        Self {
            outcome: "failed",
            reason: error.for_records(),
            message: error.to_string(),
            blame: Some(error.error_kind()),
            ..Self::scored(video, "")
        }
    }

    fn has_failed(&self) -> bool {
        self.blame.is_some()
    }

    /// Returns its subject, with the reason where there is one.
    fn line(&self) -> String {
        let name = if self.sequence.is_empty() {
            &self.video
        } else {
            &self.sequence
        };
        let is_named = match self.sequence.is_empty() {
            // Messages name their file, by its path.
            true => self.message.contains(name.as_str()),
            false => self.message.starts_with(name.as_str()),
        };
        if self.message.is_empty() {
            name.clone()
        } else if is_named {
            self.message.clone()
        } else {
            format!("{name}: {}", self.message)
        }
    }
}

/// All rows of the summary.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outcomes {
    pub(crate) list: Vec<Outcome>,
}

impl Outcomes {
    pub(crate) fn push(&mut self, outcome: Outcome) {
        self.list.push(outcome);
    }

    pub(crate) fn scored(&self) -> usize {
        self.list
            .iter()
            .filter(|row| row.outcome == "scored")
            .count()
    }

    /// Returns one line per row.
    pub(crate) fn text(&self) -> String {
        self.list
            .iter()
            .map(|row| format!("{:<7} {}\n", row.outcome, row.line()))
            .collect()
    }

    /// Writes the rows as CSV, whole or not at all.
    pub(crate) fn write_csv(&self, path: &Path) -> Result<(), StoreError> {
        store::write_csv_rows(path, &self.list)
    }

    /// Returns an error when anything failed.
    pub(crate) fn as_result(&self) -> anyhow::Result<()> {
        let failed: Vec<&Outcome> = self.list.iter().filter(|row| row.has_failed()).collect();
        let Some(first) = failed.first() else {
            return Ok(());
        };
        let message = match (failed.len(), self.list.len()) {
            (_, 1) => first.line(),
            (1, total) => format!("1 of {total} videos or sequences failed: {}", first.line()),
            (failures, total) => format!(
                "{failures} of {total} videos or sequences failed, the first: {}",
                first.line()
            ),
        };
        Err(PartialFailure {
            message,
            blame: if failed
                .iter()
                .any(|row| row.blame == Some(ErrorKind::Internal))
            {
                ErrorKind::Internal
            } else {
                ErrorKind::User
            },
        }
        .into())
    }
}
