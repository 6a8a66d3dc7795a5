//! `external-run`: run of an external method on one scene.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{provenance::Hardware, store::Record};

/// `external-run.json`. Files are relative to its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExternalRun {
    /// Id of the method.
    pub method: String,
    /// Address of its code, from its manifest.
    pub source: Option<String>,
    /// Its licence, as its manifest says.
    pub licence: Option<String>,
    /// SHA-256 of the manifest; empty in the record of a run that left none itself.
    pub manifest_sha256: String,
    /// Id of the scene.
    pub scene: String,
    /// Hash of the split's protocol.
    pub protocol_hash: String,
    /// Random seed that was handed to the method.
    pub seed: u64,
    /// Environment of its commands, in words: `plain`, `venv ...`, `conda ...`, `container ...`.
    pub environment: String,
    /// The machine on which its commands ran; records of older versions do not say.
    #[serde(default)]
    pub hardware: Option<Hardware>,
    /// Name and version of the program that ran them, with the commit. What the method itself is
    /// made of is for its manifest to say.
    #[serde(default)]
    pub versions: BTreeMap<String, String>,
    /// Its commands in the order in which they ran; the last one is the one that failed, if any.
    pub phases: Vec<Phase>,
    /// Why there may be no predictions. A run that failed is scored all the same: its missing
    /// views are failures in the result.
    pub failure: Option<String>,
    /// Folder of predicted novel views, gathered from where the method left them.
    pub novel_views: String,
    /// Folder of predicted input views, where the method renders them.
    pub input_views: Option<String>,
    /// Warnings that a reader of the scores should know.
    pub warnings: Vec<String>,
    /// SHA-256 of the split, and of the files of the scene by their names, before the commands ran; records of older
    /// versions lack them.
    #[serde(default)]
    pub inputs: BTreeMap<String, String>,
}

impl ExternalRun {
    /// Name of the stage that writes a run.
    pub const STAGE: &'static str = "external";
}

impl Record for ExternalRun {
    const SCHEMA: &'static str = "omnilife/external-run/1";
}

/// One command of a method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Phase {
    /// Phase of the command.
    pub name: PhaseName,
    /// Program and arguments as they ran.
    pub command: Vec<String>,
    /// Everything it printed.
    pub log: String,
    /// End of the command, in words: `exit 0`, `exit 3`, `killed by signal 9`, `time limit of 60 s`.
    pub ending: String,
    /// Processes and containers that ran on when it had ended, or did not end when they were told to,
    /// in words: `sleep (process 4711)`. All were ended before the next command began, but for those
    /// that say that they could not be; records of older versions have none.
    #[serde(default)]
    pub left_running: Vec<String>,
    /// Wall-clock time, seconds.
    pub wall_seconds: f64,
    /// CPU time, user and system, of the command and the children it waited for,
    /// seconds, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Highest resident memory of one of its processes, bytes, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// Phase of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PhaseName {
    /// Brings the scene into the form the method reads.
    Prepare,
    /// Trains; its time is the training time in the tables.
    Train,
    /// Renders the views.
    Render,
}

impl PhaseName {
    /// Returns the name that records and file names use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prepare => "prepare",
            Self::Train => "train",
            Self::Render => "render",
        }
    }
}
