//! What became of every video and sequence of a job.

use std::{fmt::Display, path::Path};

use omnilife_schemas::{
    Blame,
    store::{self, StoreError},
};
use serde::Serialize;

use crate::exit::PartialFailure;

/// One row of the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Outcome {
    /// The video as given.
    pub(crate) video: String,
    /// Id of the sequence; empty for a video without sequences.
    pub(crate) sequence: String,
    /// `scored`, `curated`, `failed`.
    pub(crate) outcome: &'static str,
    /// One line for what failed.
    pub(crate) reason: String,
    #[serde(skip)]
    blame: Option<Blame>,
}

impl Outcome {
    /// A sequence went all the way.
    pub(crate) fn scored(video: &str, sequence: &str) -> Self {
        Self {
            video: video.to_owned(),
            sequence: sequence.to_owned(),
            outcome: "scored",
            reason: String::new(),
            blame: None,
        }
    }

    /// A video gave sequences, and no more was asked for.
    pub(crate) fn curated(video: &str) -> Self {
        Self {
            outcome: "curated",
            ..Self::scored(video, "")
        }
    }

    /// Something failed.
    pub(crate) fn failed(video: &str, sequence: &str, reason: impl Display, blame: Blame) -> Self {
        Self {
            outcome: "failed",
            reason: reason.to_string(),
            blame: Some(blame),
            ..Self::scored(video, sequence)
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

    /// How many sequences were scored.
    pub(crate) fn scored(&self) -> usize {
        self.list
            .iter()
            .filter(|row| row.outcome == "scored")
            .count()
    }

    /// One line per row.
    pub(crate) fn text(&self) -> String {
        self.list
            .iter()
            .map(|row| {
                let name = if row.sequence.is_empty() {
                    &row.video
                } else {
                    &row.sequence
                };
                if row.reason.is_empty() {
                    format!("{:<7} {name}\n", row.outcome)
                } else {
                    format!("{:<7} {name}: {}\n", row.outcome, row.reason)
                }
            })
            .collect()
    }

    /// Writes the rows as CSV, whole or not at all.
    pub(crate) fn write_csv(&self, path: &Path) -> Result<(), StoreError> {
        store::write_with(path, |writer| {
            let mut table = csv::Writer::from_writer(writer);
            for row in &self.list {
                table.serialize(row).map_err(std::io::Error::other)?;
            }
            table.flush()
        })
    }

    /// An error when anything failed.
    pub(crate) fn verdict(&self) -> anyhow::Result<()> {
        let blames: Vec<Blame> = self.list.iter().filter_map(|row| row.blame).collect();
        if blames.is_empty() {
            return Ok(());
        }
        Err(PartialFailure {
            failures: blames.len(),
            total: self.list.len(),
            blame: if blames.contains(&Blame::Ours) {
                Blame::Ours
            } else {
                Blame::Input
            },
        }
        .into())
    }
}
