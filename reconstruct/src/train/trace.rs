//! Error against run time: one row now and then while a method trains.

use std::path::Path;

use omnilife_schemas::{
    records::SurfaceFaults,
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use omnilife_engine::{model::TrainedArray, step::StepStatistics};

use crate::learner::ModelSize;
use crate::process;
use crate::train::checkpoint::LoopState;

/// One row of error against run time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TracePoint {
    /// Wall-clock time of planning and of the training steps so far; the trace's own renders and the
    /// checkpoints are not counted.
    pub wall_seconds: f64,
    /// Wall-clock time of the trace's own renders so far.
    pub evaluation_seconds: f64,
    /// CPU time (user and system) of planning and of the training steps so far, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Iterations done.
    pub iteration: u64,
    /// Primitives of the model: Gaussians, or whatever else it is made of.
    #[serde(alias = "gaussians")]
    pub primitives: u64,
    /// Bytes of parameters, gradients and moments.
    pub table_bytes: u64,
    /// Highest resident memory of the process so far, where the system tells.
    pub peak_memory_bytes: Option<u64>,
    /// Mean training loss since the row before.
    pub train_loss: f64,
    /// PSNR of the mean squared error over the training steps since the row before, dB.
    pub train_psnr_db: f64,
    /// Ghosts and holes, where the scene knows distances and they were looked for.
    #[serde(default)]
    pub surfaces: Option<SurfaceFaults>,
    /// Gradient values that were not finite and were not applied since the row before, by name of
    /// the parameter array.
    pub refused: Vec<(String, u64)>,
}

const COLUMNS: [&str; 9] = [
    "wall_seconds",
    "evaluation_seconds",
    "cpu_seconds",
    "iteration",
    "primitives",
    "table_bytes",
    "peak_memory_bytes",
    "train_loss",
    "train_psnr_db",
];

/// Columns of ghosts and holes.
const SURFACE_COLUMNS: [&str; 3] = ["ghost_share", "input_hole_share", "novel_hole_share"];

impl TracePoint {
    /// A row from where the loop stands, the sums since the row before, the size of the model, and
    /// the arrays.
    pub(super) fn new(
        state: &LoopState,
        statistics: &StepStatistics,
        size: ModelSize,
        arrays: &[TrainedArray],
    ) -> Self {
        let steps = statistics.steps.max(1) as f64;
        let refused = statistics.refused.iter().chain(std::iter::repeat(&0));
        Self {
            wall_seconds: state.training.as_secs_f64(),
            evaluation_seconds: state.evaluation.as_secs_f64(),
            cpu_seconds: state.training_cpu.map(|time| time.as_secs_f64()),
            iteration: state.iteration,
            primitives: size.primitives,
            table_bytes: size.bytes,
            peak_memory_bytes: process::peak_memory_bytes(),
            train_loss: statistics.loss / steps,
            train_psnr_db: -10.0 * (statistics.squared_error / steps).max(1e-10).log10(),
            surfaces: None,
            refused: arrays
                .iter()
                .zip(refused)
                .map(|(array, &refused)| (array.name.to_owned(), refused))
                .collect(),
        }
    }

    /// A short status for people.
    pub(super) fn text(&self) -> String {
        format!(
            "{} primitives, input views {:.2} dB",
            self.primitives, self.train_psnr_db
        )
    }

    fn cells(&self, with_surfaces: bool) -> Vec<String> {
        fn or_empty(value: Option<impl ToString>) -> String {
            value.map_or(String::new(), |value| value.to_string())
        }
        let fixed = [
            self.wall_seconds.to_string(),
            self.evaluation_seconds.to_string(),
            or_empty(self.cpu_seconds),
            self.iteration.to_string(),
            self.primitives.to_string(),
            self.table_bytes.to_string(),
            or_empty(self.peak_memory_bytes),
            self.train_loss.to_string(),
            self.train_psnr_db.to_string(),
        ];
        let found = self.surfaces.as_ref();
        let surfaces = [
            or_empty(found.map(|found| found.ghost_share)),
            or_empty(found.and_then(|found| found.input_hole_share)),
            or_empty(found.and_then(|found| found.novel_hole_share)),
        ];
        let surfaces = surfaces.into_iter().filter(|_| with_surfaces);
        let refused = self.refused.iter().map(|(_, count)| count.to_string());
        fixed.into_iter().chain(surfaces).chain(refused).collect()
    }
}

/// Writes the rows so far as CSV, whole or not at all; `refused_<array>` columns stand at the end, those of
/// ghosts and holes before them where any row has some.
///
/// # Errors
/// When the file cannot be written.
pub fn write_csv(path: &Path, trace: &[TracePoint]) -> Result<(), StoreError> {
    store::write_csv(path, |table| {
        let with_surfaces = trace.iter().any(|point| point.surfaces.is_some());
        let surfaces = SURFACE_COLUMNS.iter().filter(|_| with_surfaces);
        let refused = trace.first().map_or(&[][..], |point| &point.refused);
        let header = COLUMNS
            .map(str::to_owned)
            .into_iter()
            .chain(surfaces.map(|&name| name.to_owned()))
            .chain(refused.iter().map(|(array, _)| format!("refused_{array}")));
        table.write_record(header)?;
        for point in trace {
            table.write_record(point.cells(with_surfaces))?;
        }
        Ok(())
    })
}
