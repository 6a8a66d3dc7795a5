//! Checkpoints: everything that training needs to go on as if it had never stopped.
//!
//! ```text
//! omnilife/checkpoint/3\n
//! {"inputs_sha256": ..., "settings": ..., "state": ..., "learner": ..., "body_sha256": ...}\n
//! body: what the learner saved
//! ```
//!
//! On the CPU a run that is continued gives the same bits as one that was never interrupted, unless a
//! time budget steers it.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs, io::Write, path::Path, time::Duration};

use omnilife_engine::{model::saved::LoadError, step::StepStatistics};
use omnilife_schemas::store::{self, StoreError};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::{LoopSettings, trace::TracePoint};
use crate::{
    learner::{Learner, SavedLearner},
    process,
};

const MAGIC: &str = "omnilife/checkpoint/";
const VERSION: &str = "3";

/// Where the loop stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopState {
    /// Iterations done.
    pub iteration: u64,
    /// The random stream of the order of views.
    pub view_order: Pcg64Mcg,
    /// Views left in this epoch, the next one last.
    pub queue: Vec<usize>,
    /// Wall-clock time of the training steps.
    pub training: Duration,
    /// Wall-clock time of the trace's renders.
    pub evaluation: Duration,
    /// CPU time of the training steps, where the system tells.
    pub training_cpu: Option<Duration>,
    /// Sums over the steps since the last row of the trace.
    pub since_trace: StepStatistics,
    /// Gradient values that were not finite, for each array, over the whole run.
    pub refused: Vec<u64>,
    /// Error against run time.
    pub trace: Vec<TracePoint>,
    /// How often the run was interrupted and continued.
    pub resumed: u64,
}

impl LoopState {
    /// The beginning.
    pub(super) fn new(view_order: Pcg64Mcg) -> Self {
        Self {
            iteration: 0,
            view_order,
            queue: Vec::new(),
            training: Duration::ZERO,
            evaluation: Duration::ZERO,
            training_cpu: process::own_cpu_time().map(|_| Duration::ZERO),
            since_trace: StepStatistics::default(),
            refused: Vec::new(),
            trace: Vec::new(),
            resumed: 0,
        }
    }
}

#[derive(Serialize, Deserialize)]
struct Header {
    inputs_sha256: String,
    settings: LoopSettings,
    state: LoopState,
    learner: String,
    body_sha256: String,
}

/// Why a checkpoint cannot be continued.
#[derive(Debug)]
pub enum Refusal {
    /// It belongs to another scene, split, method or configuration: training begins anew.
    OtherRun(String),
    /// It cannot be used by anything.
    Damaged(StoreError),
}

/// Writes a checkpoint, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    inputs_sha256: &str,
    settings: &LoopSettings,
    state: &LoopState,
    saved: &SavedLearner,
) -> Result<(), StoreError> {
    let header = Header {
        inputs_sha256: inputs_sha256.to_owned(),
        settings: *settings,
        state: state.clone(),
        learner: saved.header.clone(),
        body_sha256: store::sha256_bytes(&saved.body),
    };
    let header = serde_json::to_string(&header)
        .map_err(|error| StoreError::write(path, std::io::Error::other(error)))?;
    store::write_with(path, |writer| {
        writeln!(writer, "{MAGIC}{VERSION}")?;
        writeln!(writer, "{header}")?;
        writer.write_all(&saved.body)
    })
}

/// Reads the checkpoint of a run with these inputs and settings into `learner`, which is as the run
/// began; returns where the loop stood.
///
/// # Errors
/// When it is not the run's, or truncated, damaged or not finite.
pub fn read(
    path: &Path,
    inputs_sha256: &str,
    settings: &LoopSettings,
    learner: &mut dyn Learner,
) -> Result<LoopState, Refusal> {
    let bytes =
        fs::read(path).map_err(|source| Refusal::Damaged(StoreError::read(path, source)))?;
    let damaged = |reason: String| {
        Refusal::Damaged(StoreError::malformed(
            path,
            format!("{reason}; remove it to begin anew"),
        ))
    };
    let (header, body) = split(&bytes).map_err(damaged)?;
    let header: Header = serde_json::from_str(header)
        .map_err(|error| damaged(format!("its header is not readable: {error}")))?;
    if header.inputs_sha256 != inputs_sha256 {
        return Err(Refusal::OtherRun(
            "it is of another scene, split or request".to_owned(),
        ));
    }
    if header.settings != *settings {
        return Err(Refusal::OtherRun("its settings differ".to_owned()));
    }
    if store::sha256_bytes(body) != header.body_sha256 {
        return Err(damaged(
            "is truncated or damaged: its content is not what was written".to_owned(),
        ));
    }
    let saved = SavedLearner {
        header: header.learner,
        body: body.to_vec(),
    };
    match learner.restore(&saved) {
        Ok(()) => Ok(header.state),
        Err(LoadError::Other) => Err(Refusal::OtherRun("its model is another one".to_owned())),
        Err(LoadError::Damaged(reason)) => Err(damaged(reason)),
    }
}

/// The header's JSON and the body.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    let not_one = || "is not a checkpoint".to_owned();
    let (first, rest) = line(bytes).ok_or_else(not_one)?;
    let version = std::str::from_utf8(first)
        .ok()
        .and_then(|line| line.strip_prefix(MAGIC))
        .ok_or_else(not_one)?;
    if version != VERSION {
        return Err(format!(
            "is a checkpoint of version {version}, expected {VERSION}"
        ));
    }
    let (header, body) = line(rest).ok_or("is truncated: its header does not end")?;
    let header = std::str::from_utf8(header).map_err(|_| "its header is not UTF-8".to_owned())?;
    Ok((header, body))
}

/// The first line and what follows it.
fn line(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let mut parts = bytes.splitn(2, |&byte| byte == b'\n');
    Some((parts.next()?, parts.next()?))
}

#[cfg(test)]
mod tests;
