//! Checkpoints: the complete state that training needs to resume exactly.
//!
//! ```text
//! omnilife/checkpoint/3\n
//! {"inputs_sha256": ..., "settings": ..., "state": ..., "normalization": ..., "learner": ..., "body_sha256": ...}\n
//! body: what the learner saved
//! ```
//!
//! On the CPU a resumed run gives the same bits as one without interruption, unless a time budget steers it.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs, io::Write, path::Path, time::Duration};

use omnilife_engine::{model::saved::LoadError, step::StepStatistics};
use omnilife_schemas::{
    Similarity,
    store::{self, StoreError},
};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::{LoopSettings, trace::TracePoint};
use crate::{
    learner::{Learner, SavedLearner},
    process,
};

const MAGIC: &str = "omnilife/checkpoint/";
const VERSION: &str = "3";

/// State of the loop.
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
    /// CPU time of the training steps, if the system reports it.
    pub training_cpu: Option<Duration>,
    /// Sums over the steps since the last row of the trace.
    pub since_trace: StepStatistics,
    /// Gradient values that were not finite, for each array, over the whole run.
    pub refused: Vec<u64>,
    /// Error against run time.
    pub trace: Vec<TracePoint>,
    /// Number of times that the run was interrupted and resumed.
    pub resumed: u64,
}

impl LoopState {
    /// Returns the state at the start.
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
    /// Normalized coordinates of the scene, for programs that show the model in the world. A resumed run has its own.
    #[serde(default)]
    normalization: Option<Similarity>,
    learner: String,
    body_sha256: String,
}

/// Reason why a run cannot resume from a checkpoint.
#[derive(Debug)]
pub enum Refusal {
    /// It belongs to another scene, split, method or configuration: training starts anew.
    OtherRun(String),
    /// It is unusable.
    Damaged(StoreError),
}

/// Writes a checkpoint of a scene with this normalization, atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    inputs_sha256: &str,
    settings: &LoopSettings,
    normalization: &Similarity,
    state: &LoopState,
    saved: &SavedLearner,
) -> Result<(), StoreError> {
    let header = Header {
        inputs_sha256: inputs_sha256.to_owned(),
        settings: *settings,
        state: state.clone(),
        normalization: Some(*normalization),
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

/// Reads the checkpoint of a run with these inputs and settings into `learner`, which must be at the run's start;
/// returns the state of the loop.
///
/// # Errors
/// When it belongs to another run, or is truncated, damaged or not finite.
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

/// Returns the header's JSON and the body.
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

/// Returns the first line and the rest.
fn line(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let mut parts = bytes.splitn(2, |&byte| byte == b'\n');
    Some((parts.next()?, parts.next()?))
}

#[cfg(test)]
mod tests;
