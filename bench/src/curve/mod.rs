//! Error against run time: from the novel views along a training to its curve, and from curves to time-to-quality
//! tables, plots and the Pareto front.
//!
//! Time, wall-clock or CPU time, is that of planning and of the training steps alone; the time for rendering
//! the views along it is reported beside it. Quality is the mean PSNR of the novel views at a row of the trace, by the
//! metric that scores the predictions. Runs are compared if scene and protocol are the same. A run without scores along
//! its training is a point, with a line: its training time and its score. That is a method that does not train, a
//! program of others, or a training that kept no views.

mod drawing;
mod files;
mod measures;
pub(crate) mod rows;
mod table;
mod trace;

use std::path::{Path, PathBuf};

use omnilife_schemas::{progress::Progress, stage::StagePlan};

use crate::error::BenchError;
pub use files::{CURVES_FILE, POINTS_FILE};
pub use measures::{BELOW_END_DB, Crossing, MOMENTS_SECONDS, QUALITIES_DB, RunCurve, Span};
pub use table::curves_table;
pub use trace::{Clock, FinalScores, Region, TraceRow, TracedRun, read_run};

/// Returns the reason why scores of two runs of a scene are not of the same views; `None` if they are.
fn other_views(first: &TracedRun, run: &TracedRun) -> Option<String> {
    let folder = first.folder.display();
    let has_hashes = !first.scene_sha256.is_empty() && !run.scene_sha256.is_empty();
    if has_hashes && first.scene_sha256 != run.scene_sha256 {
        return Some(format!(
            "is of other cameras or images of {} than {folder}",
            run.scene
        ));
    }
    // Curves of older versions do not say how many.
    let are_known = first.novel_views > 0 && run.novel_views > 0;
    (are_known && first.novel_views != run.novel_views).then(|| {
        format!(
            "has scores of {} novel views along its training, {folder} of {}: the curves must be of the same views \
             (--trace-views of training)",
            run.novel_views, first.novel_views
        )
    })
}

/// Runs of one scene and protocol, measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Id of the scene.
    pub scene: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// The runs in the order in which they were given.
    pub curves: Vec<RunCurve>,
    /// The time over which areas are taken, if the runs have one in common.
    pub span: Option<Span>,
    /// Lines on runs that could not be compared.
    pub notes: Vec<String>,
}

/// Reads runs (the folders of their scores, or the `result.json` there), compares those of one scene and protocol, and
/// writes `curves.csv`, `points.csv` and one `curve-<n>.svg` per comparison into `out`.
///
/// # Errors
/// When a run has no scores of novel views in the region ([`read_run`]), a foreign file is in the way, or a file cannot
/// be read or written.
pub fn curves(
    runs: &[PathBuf],
    clock: Clock,
    region: Region,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Comparison>, BenchError> {
    let mut groups: Vec<((String, String), Vec<TracedRun>)> = Vec::new();
    for path in runs {
        let run = read_run(path, clock, region)?;
        let key = (run.scene.clone(), run.protocol_hash.clone());
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, runs)) => {
                let reason = runs.first().and_then(|first| other_views(first, &run));
                if let Some(reason) = reason {
                    return Err(BenchError::mismatch(path, reason));
                }
                runs.push(run);
            }
            None => groups.push((key, vec![run])),
        }
    }
    let drawings = (0..groups.len()).map(drawing_file);
    let files: Vec<String> = [CURVES_FILE, POINTS_FILE]
        .map(str::to_owned)
        .into_iter()
        .chain(drawings)
        .collect();
    let stage = StagePlan::new(out, "curves");
    stage.run(&files, progress, |made| {
        stage
            .own_files()
            .remove(|file| !files.iter().any(|new| new == file))?;
        let mut comparisons = Vec::new();
        for (number, ((scene, protocol_hash), runs)) in groups.iter().enumerate() {
            let file = drawing_file(number);
            let drawing = drawing::of_runs(scene, (clock, region), runs)
                .map_err(|reason| BenchError::internal(&made.path(&file), reason.to_string()))?;
            made.write_bytes(&file, drawing.as_bytes())?;
            let (span, mut notes) = match measures::common_span(runs) {
                Ok(span) => (Some(span), Vec::new()),
                Err(reason) => (None, vec![format!("no area: {reason}")]),
            };
            notes.extend(without_rows(runs, clock));
            comparisons.push(Comparison {
                scene: scene.clone(),
                protocol_hash: protocol_hash.clone(),
                curves: measures::measured(runs, span),
                span,
                notes,
            });
        }
        files::write_curves(&out.join(CURVES_FILE), &comparisons)?;
        let runs = groups.iter().flat_map(|(_, runs)| runs);
        files::write_points(&out.join(POINTS_FILE), runs)?;
        made.add_all([CURVES_FILE, POINTS_FILE]);
        Ok(comparisons)
    })
}

fn drawing_file(number: usize) -> String {
    format!("curve-{number}.svg")
}

/// Returns a line for every run without scores along its training: its place in table and plot.
fn without_rows(runs: &[TracedRun], clock: Clock) -> impl Iterator<Item = String> {
    let names = trace::names(&runs.iter().collect::<Vec<_>>());
    let of_end = runs
        .iter()
        .zip(names)
        .filter(|(run, _)| run.rows.is_empty());
    of_end.map(move |(run, name)| {
        let time = match clock {
            Clock::Wall => "training time",
            Clock::Cpu => "CPU time of the training",
        };
        match run.training_seconds {
            None => format!("{name}: no record has the {time}; its score is drawn as a level"),
            Some(seconds) if seconds > 0.0 => {
                format!("{name}: no scores along its training; its end is a point")
            }
            Some(_) => format!("{name}: no training; its score is drawn as a level"),
        }
    })
}
