//! The trace of a training run, as its record and CSV tell it.

use std::path::Path;

use omnilife_schemas::{
    records::RunRecord,
    store::{self, StoreError},
};
use serde::Deserialize;

use crate::error::BenchError;

/// Which time counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clock {
    /// Wall-clock time: what a user waits.
    #[default]
    Wall,
    /// Processor time of all threads: what compares runs of a machine that has other work too.
    Cpu,
}

impl Clock {
    /// As it stands in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wall => "wall",
            Self::Cpu => "cpu",
        }
    }
}

/// A run with its trace.
#[derive(Debug, Clone, PartialEq)]
pub struct TracedRun {
    /// Id of the method.
    pub method: String,
    /// Id of the scene.
    pub scene: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// Random seed.
    pub seed: u64,
    /// The clock of its times.
    pub clock: Clock,
    /// Time of all training steps, seconds.
    pub training_seconds: f64,
    /// Wall-clock time of the trace's own scores, seconds; the training time is without it.
    pub evaluation_seconds: f64,
    /// Iterations done.
    pub iterations: u64,
    /// Gaussians at the end.
    pub gaussians: u64,
    /// Highest resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Rows with a score, in order of time; at least one.
    pub rows: Vec<TraceRow>,
}

/// A scored moment of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceRow {
    /// Time of the training steps so far, seconds.
    pub seconds: f64,
    /// Wall-clock time of scoring so far, seconds.
    pub evaluation_seconds: f64,
    /// Iterations done.
    pub iteration: u64,
    /// Gaussians.
    pub gaussians: u64,
    /// Mean PSNR of the novel views, dB.
    pub psnr_db: f64,
    /// Mean SSIM of the novel views.
    pub ssim: Option<f64>,
}

impl TracedRun {
    /// Method and seed.
    pub fn name(&self) -> String {
        format!("{}, seed {}", self.method, self.seed)
    }
}

/// The columns that are needed; a trace has more.
#[derive(Deserialize)]
struct Columns {
    wall_seconds: f64,
    #[serde(default)]
    cpu_seconds: Option<f64>,
    #[serde(default)]
    evaluation_seconds: f64,
    iteration: u64,
    #[serde(default)]
    gaussians: u64,
    novel_psnr_db: Option<f64>,
    #[serde(default)]
    novel_ssim: Option<f64>,
}

/// Reads a run from its folder or its `run.json`.
///
/// # Errors
/// When it has no trace, or the trace is malformed, goes back in time, never scored novel views, or
/// does not know the time that is asked for.
pub fn read_run(path: &Path, clock: Clock) -> Result<TracedRun, BenchError> {
    let file = if path.is_dir() {
        path.join("run.json")
    } else {
        path.to_owned()
    };
    let record: RunRecord = store::read_record(&file)?;
    let Some(trace) = &record.trace else {
        return Err(BenchError::mismatch(
            &file,
            format!(
                "{} leaves no trace of error against run time",
                record.method
            ),
        ));
    };
    let trace = file.with_file_name(trace);
    let text = std::fs::read(&trace).map_err(|source| StoreError::read(&trace, source))?;
    let mut rows = Vec::new();
    for row in csv::Reader::from_reader(text.as_slice()).deserialize::<Columns>() {
        let row = row.map_err(|error| BenchError::mismatch(&trace, error.to_string()))?;
        let Some(psnr_db) = row.novel_psnr_db else {
            continue;
        };
        let seconds = match clock {
            Clock::Wall => row.wall_seconds,
            Clock::Cpu => row.cpu_seconds.ok_or_else(|| {
                BenchError::mismatch(&trace, "does not know the processor time of the training")
            })?,
        };
        if !(seconds.is_finite() && psnr_db.is_finite()) {
            return Err(BenchError::mismatch(
                &trace,
                format!("iteration {} has a value that is not finite", row.iteration),
            ));
        }
        rows.push(TraceRow {
            seconds,
            evaluation_seconds: row.evaluation_seconds,
            iteration: row.iteration,
            gaussians: row.gaussians,
            psnr_db,
            ssim: row.novel_ssim,
        });
    }
    if rows.is_empty() {
        return Err(BenchError::mismatch(&trace, "scores no novel views"));
    }
    if !rows.is_sorted_by_key(|row| row.seconds) {
        return Err(BenchError::mismatch(&trace, "goes back in time"));
    }
    let training_seconds = match (clock, record.training_cpu_seconds) {
        (Clock::Cpu, Some(seconds)) => seconds,
        (Clock::Cpu, None) => rows.last().map_or(0.0, |row| row.seconds),
        (Clock::Wall, _) => record.training_seconds,
    };
    Ok(TracedRun {
        clock,
        method: record.method,
        scene: record.scene,
        protocol_hash: record.protocol_hash,
        seed: record.seed,
        training_seconds,
        evaluation_seconds: record.evaluation_seconds,
        iterations: record.iterations,
        gaussians: record.gaussians,
        peak_memory_bytes: record.peak_memory_bytes,
        rows,
    })
}
