//! Error against run time: rows of a trace during training.

use std::path::Path;

use omnilife_schemas::{
    records::SurfaceFaults,
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use omnilife_engine::{model::TrainedArray, step::StepStatistics};

use crate::{
    learner::ModelSize,
    process,
    train::{checkpoint::LoopState, input_psnr::InputPsnr},
};

/// One row of error against run time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TracePoint {
    /// Wall-clock time of planning and of the training steps so far; the trace's own renders and the
    /// checkpoints are not counted.
    pub wall_seconds: f64,
    /// Wall-clock time of the trace's own renders so far.
    pub evaluation_seconds: f64,
    /// CPU time (user and system) of planning and of the training steps so far, if the system reports it.
    pub cpu_seconds: Option<f64>,
    /// Iterations done.
    pub iteration: u64,
    /// Number of primitives of the model: Gaussians, or others.
    #[serde(alias = "gaussians")]
    pub primitives: u64,
    /// Number of objects that move as one, if the model distinguishes objects.
    #[serde(default)]
    pub objects: Option<u64>,
    /// Bytes of parameters, gradients and moments.
    pub table_bytes: u64,
    /// Highest resident memory of the process so far, if the system reports it.
    pub peak_memory_bytes: Option<u64>,
    /// Mean training loss since the row before; `None` before the first step.
    pub train_loss: Option<f64>,
    /// PSNR of the mean squared error over the training steps since the row before, dB; `None` before the first
    /// step.
    pub train_psnr_db: Option<f64>,
    /// PSNR of some input views by region, if they have masks and it was measured.
    #[serde(default)]
    pub input_psnr: Option<InputPsnr>,
    /// Ghosts and holes, if the scene has known distances and they were measured.
    #[serde(default)]
    pub surfaces: Option<SurfaceFaults>,
    /// Number of gradient values since the row before that were not finite and not applied, by name of the
    /// parameter array.
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

/// Optional columns, written if any row of a trace has a value: objects, input views by region, ghosts and holes.
const FURTHER_COLUMNS: [&str; 7] = [
    "objects",
    "input_psnr_db",
    "input_psnr_static_db",
    "input_psnr_dynamic_db",
    "ghost_share",
    "input_hole_share",
    "novel_hole_share",
];

impl TracePoint {
    /// Makes a row from the state of the loop, the sums since the row before, the size of the model, and the
    /// arrays.
    pub(super) fn new(
        state: &LoopState,
        statistics: &StepStatistics,
        size: ModelSize,
        arrays: &[TrainedArray],
    ) -> Self {
        let per_step = |sum: f64| (statistics.steps > 0).then_some(sum / statistics.steps as f64);
        let squared_error = per_step(statistics.squared_error);
        let refused = statistics.refused.iter().chain(std::iter::repeat(&0));
        Self {
            wall_seconds: state.training.as_secs_f64(),
            evaluation_seconds: state.evaluation.as_secs_f64(),
            cpu_seconds: state.training_cpu.map(|time| time.as_secs_f64()),
            iteration: state.iteration,
            primitives: size.primitives,
            objects: size.objects,
            table_bytes: size.bytes,
            peak_memory_bytes: process::peak_memory_bytes(),
            train_loss: per_step(statistics.loss),
            train_psnr_db: squared_error.map(|error| -10.0 * error.max(1e-10).log10()),
            input_psnr: None,
            surfaces: None,
            refused: arrays
                .iter()
                .zip(refused)
                .map(|(array, &refused)| (array.name.to_owned(), refused))
                .collect(),
        }
    }

    /// Returns a short status for the user: size of the model, and use of the loop's time; planning came before
    /// it.
    pub(super) fn text(&self, planning_seconds: f64) -> String {
        let input_views = self
            .train_psnr_db
            .map_or(String::new(), |db| format!("input views {db:.2} dB, "));
        format!(
            "{} primitives, {input_views}steps {:.1} s, measuring {:.1} s",
            self.primitives,
            (self.wall_seconds - planning_seconds).max(0.0),
            self.evaluation_seconds
        )
    }

    /// Returns the time that spaces the rows: CPU time, or wall-clock time if the system does not report it, seconds.
    fn clock_seconds(&self) -> f64 {
        self.cpu_seconds.unwrap_or(self.wall_seconds)
    }

    /// Returns the known values with their columns, without the counts of single arrays.
    pub(super) fn known(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let fixed = COLUMNS.into_iter().zip(self.fixed());
        let further = FURTHER_COLUMNS.into_iter().zip(self.further());
        fixed
            .chain(further)
            .filter_map(|(column, value)| Some((column, value?)))
    }

    /// Returns the values of [`COLUMNS`].
    fn fixed(&self) -> [Option<f64>; 9] {
        let count = |value: u64| Some(value as f64);
        [
            Some(self.wall_seconds),
            Some(self.evaluation_seconds),
            self.cpu_seconds,
            count(self.iteration),
            count(self.primitives),
            count(self.table_bytes),
            self.peak_memory_bytes.and_then(count),
            self.train_loss,
            self.train_psnr_db,
        ]
    }

    /// Returns the values of [`FURTHER_COLUMNS`].
    fn further(&self) -> [Option<f64>; 7] {
        let psnr = self.input_psnr.unwrap_or_default();
        let faults = self.surfaces.as_ref();
        [
            self.objects.map(|count| count as f64),
            psnr.whole_db,
            psnr.static_db,
            psnr.dynamic_db,
            faults.map(|found| found.ghost_share),
            faults.and_then(|found| found.input_hole_share),
            faults.and_then(|found| found.novel_hole_share),
        ]
    }
}

/// Returns true if CPU time has passed 1, 1.41, 2, 2.83 ... seconds, or their fractions, since the last row: the
/// rows by default.
///
/// The times are the same for all methods, so that their curves have rows side by side. Equal ratios suit curves over
/// the logarithm of time: at two rows per octave, straight lines between rows are off by about 0.01 dB in the mean.
pub(super) fn is_due(state: &LoopState) -> bool {
    let before = state.trace.last().map_or(0.0, TracePoint::clock_seconds);
    let now = state.training_cpu.unwrap_or(state.training).as_secs_f64();
    half_octave(now) > half_octave(before)
}

/// Returns the number of half octaves from one second on, rounded down; minus infinity for time 0.
fn half_octave(seconds: f64) -> f64 {
    (2.0 * seconds.log2()).floor()
}

fn or_empty(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

/// Writes the rows so far as CSV, atomically. `refused_<array>` columns are at the end, after the optional
/// columns with values.
///
/// # Errors
/// When the file cannot be written.
pub fn write_csv(path: &Path, trace: &[TracePoint]) -> Result<(), StoreError> {
    let further: Vec<_> = trace.iter().map(TracePoint::further).collect();
    let filled: Vec<usize> = (0..FURTHER_COLUMNS.len())
        .filter(|&column| further.iter().any(|values| values[column].is_some()))
        .collect();
    store::write_csv(path, |table| {
        let refused = trace.first().map_or(&[][..], |point| &point.refused);
        let header = COLUMNS
            .map(str::to_owned)
            .into_iter()
            .chain(
                filled
                    .iter()
                    .map(|&column| FURTHER_COLUMNS[column].to_owned()),
            )
            .chain(refused.iter().map(|(array, _)| format!("refused_{array}")));
        table.write_record(header)?;
        for (point, further) in trace.iter().zip(&further) {
            let further = filled.iter().map(|&column| further[column]);
            let refused = point.refused.iter().map(|(_, count)| count.to_string());
            let cells = point.fixed().into_iter().chain(further).map(or_empty);
            table.write_record(cells.chain(refused))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn point() -> TracePoint {
        TracePoint {
            wall_seconds: 1.5,
            evaluation_seconds: 0.5,
            cpu_seconds: None,
            iteration: 100,
            primitives: 7,
            objects: None,
            table_bytes: 8,
            peak_memory_bytes: None,
            train_loss: Some(0.25),
            train_psnr_db: Some(20.0),
            input_psnr: None,
            surfaces: None,
            refused: vec![("means".to_owned(), 2)],
        }
    }

    fn written(trace: &[TracePoint]) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("trace.csv");
        write_csv(&file, trace).expect("written");
        let text = std::fs::read_to_string(file).expect("read");
        text.lines().map(str::to_owned).collect()
    }

    #[test]
    fn columns_that_nothing_is_known_of_are_left_out() {
        let fixed = "wall_seconds,evaluation_seconds,cpu_seconds,iteration,primitives,table_bytes,\
                     peak_memory_bytes,train_loss,train_psnr_db";
        let lines = written(&[point()]);
        assert_eq!(lines[0], format!("{fixed},refused_means"));
        assert_eq!(lines[1], "1.5,0.5,,100,7,8,,0.25,20,2");
        let last = TracePoint {
            objects: Some(3),
            input_psnr: Some(InputPsnr {
                whole_db: Some(25.0),
                static_db: Some(26.5),
                dynamic_db: None,
            }),
            ..point()
        };
        let lines = written(&[point(), last]);
        let columns = "objects,input_psnr_db,input_psnr_static_db";
        assert_eq!(lines[0], format!("{fixed},{columns},refused_means"));
        assert_eq!(lines[1], "1.5,0.5,,100,7,8,,0.25,20,,,,2");
        assert_eq!(lines[2], "1.5,0.5,,100,7,8,,0.25,20,3,25,26.5,2");
    }

    /// Returns the times of the rows of a run with steps of 50 ms after planning, by one of its clocks.
    fn times_of_rows(planning: Duration, steps: u32, has_cpu_time: bool) -> Vec<f64> {
        let mut state = LoopState::new(rand_pcg::Pcg64Mcg::new(1));
        for step in 0..=steps {
            let time = planning + step * Duration::from_millis(50);
            // With CPU time the wall's clock does not count.
            state.training = if has_cpu_time { 7 * time } else { time };
            state.training_cpu = has_cpu_time.then_some(time);
            if step == 0 || is_due(&state) {
                let size = ModelSize::default();
                let row = TracePoint::new(&state, &StepStatistics::default(), size, &[]);
                state.trace.push(row);
            }
        }
        state.trace.iter().map(TracePoint::clock_seconds).collect()
    }

    #[test]
    fn rows_are_at_equal_ratios_of_time() {
        for has_cpu_time in [true, false] {
            let rows = times_of_rows(Duration::from_millis(900), 640, has_cpu_time);
            // The ends of the steps at or after 1 s, 1.41 s, 2 s ...
            let expected = [
                0.9, 1.0, 1.45, 2.0, 2.85, 4.0, 5.7, 8.0, 11.35, 16.0, 22.65, 32.0,
            ];
            assert_eq!(rows.len(), expected.len(), "{rows:?}");
            for (row, expected) in rows.iter().zip(expected) {
                assert!((row - expected).abs() < 1e-9, "{rows:?}");
            }
        }
        // Steps longer than the intervals have a row each; time 0 precedes every one.
        let rows = times_of_rows(Duration::ZERO, 3, true);
        assert_eq!(rows.len(), 4, "{rows:?}");
    }

    #[test]
    fn before_the_first_step_there_is_no_loss() {
        let state = LoopState::new(rand_pcg::Pcg64Mcg::new(1));
        let size = ModelSize {
            primitives: 3,
            ..ModelSize::default()
        };
        let first = TracePoint::new(&state, &StepStatistics::default(), size, &[]);
        assert_eq!((first.iteration, first.train_loss), (0, None));
        assert_eq!(first.train_psnr_db, None);
        assert!(written(&[first])[1].ends_with(",,"));
    }

    #[test]
    fn rows_of_older_checkpoints_are_read() {
        let text = r#"{"wall_seconds":1.5,"evaluation_seconds":0.5,"cpu_seconds":null,"iteration":100,
            "gaussians":7,"table_bytes":8,"peak_memory_bytes":null,"train_loss":0.25,"train_psnr_db":20.0,
            "refused":[["means",2]]}"#;
        let read: TracePoint = serde_json::from_str(text).expect("an older row");
        assert_eq!(read, point());
    }
}
