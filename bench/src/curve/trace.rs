//! The curve of a training run, from its scores; for a run without one, its end.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{CURVE_FILE, RESULT_FILE, RUN_FILE},
    records::{RENDERING, ResultRecord, StageTime, TrainingKind},
    store,
};

use crate::{
    curve::rows::{CurveRow, read_rows},
    error::BenchError,
};

/// Which time counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clock {
    /// Wall-clock time: the user's wait.
    #[default]
    Wall,
    /// CPU time of all threads: for comparing runs on a machine with other work.
    Cpu,
}

impl Clock {
    /// Returns its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wall => "wall",
            Self::Cpu => "cpu",
        }
    }
}

/// Region of the views whose quality is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Region {
    /// Whole views.
    #[default]
    Whole,
    /// Outside of the scene's masks.
    Static,
    /// Inside of them: moving content.
    Dynamic,
}

impl Region {
    /// Returns its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Static => "static",
            Self::Dynamic => "dynamic",
        }
    }

    /// Returns the id of the metric that has the PSNR of views in the region.
    fn psnr_metric(self) -> &'static str {
        match self {
            Self::Whole => "psnr",
            Self::Static => "psnr-static",
            Self::Dynamic => "psnr-dynamic",
        }
    }

    /// Returns PSNR of a row in the region, dB: of novel views, if scored, and of input views, if measured in training.
    fn psnr_db(self, row: &CurveRow) -> [Option<f64>; 2] {
        match self {
            Self::Whole => [row.novel_psnr_db, row.input_psnr_db],
            Self::Static => [row.novel_psnr_static_db, row.input_psnr_static_db],
            Self::Dynamic => [row.novel_psnr_dynamic_db, row.input_psnr_dynamic_db],
        }
    }
}

/// A run with its trace, or with its end alone.
#[derive(Debug, Clone, PartialEq)]
pub struct TracedRun {
    /// Folder of the scores, as it was given.
    pub folder: PathBuf,
    /// Id of the method.
    pub method: String,
    /// Id of the scene.
    pub scene: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// Hash of the scene's cameras and images; empty in results of older versions.
    pub scene_sha256: String,
    /// Novel views that its scores are means over.
    pub novel_views: usize,
    /// Random seed.
    pub seed: u64,
    /// The clock of its times.
    pub clock: Clock,
    /// The region of its qualities.
    pub region: Region,
    /// Preparation time of the run's inputs, from the video on, by the same clock, seconds; none if not recorded.
    pub preparation_seconds: Option<f64>,
    /// Time of planning and of all training steps, seconds; 0 without training, none if not recorded.
    pub training_seconds: Option<f64>,
    /// Wall-clock time of rendering the trace's views, seconds; the training time is without it.
    pub evaluation_seconds: f64,
    /// Iterations done, if counted.
    pub iterations: Option<u64>,
    /// Primitives of the model at the end, if counted.
    pub primitives: Option<u64>,
    /// Highest resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Scores at the end: of the last row, or of the result without rows.
    pub final_scores: FinalScores,
    /// Rows with a score, in order of time; none if the run left no views along a training.
    pub rows: Vec<TraceRow>,
}

/// Mean scores of the novel views at the end of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FinalScores {
    /// PSNR in the region, dB.
    pub psnr_db: f64,
    /// SSIM of the whole views, if computed.
    pub ssim: Option<f64>,
    /// LPIPS (`AlexNet`) of the whole views, if computed.
    pub lpips_alex: Option<f64>,
}

impl FinalScores {
    fn of_row(row: &TraceRow) -> Self {
        Self {
            psnr_db: row.psnr_db,
            ssim: row.ssim,
            lpips_alex: row.lpips_alex,
        }
    }

    /// Returns those of a result.
    ///
    /// # Errors
    /// When the result has no PSNR of novel views in the region.
    fn of_result(file: &Path, record: &ResultRecord, region: Region) -> Result<Self, BenchError> {
        let mean = |metric: &str| record.novel_views.get(metric).map(|summary| summary.mean);
        let psnr_db = mean(region.psnr_metric()).filter(|psnr| psnr.is_finite());
        let psnr_db = psnr_db.ok_or_else(|| {
            let metric = region.psnr_metric();
            let reason = match region {
                Region::Whole => "",
                _ => ": the scene has no dynamic masks, or an older version scored it",
            };
            BenchError::mismatch(file, format!("has no {metric} of novel views{reason}"))
        })?;
        Ok(Self {
            psnr_db,
            ssim: mean("ssim"),
            lpips_alex: mean("lpips-alex"),
        })
    }
}

/// A scored moment of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceRow {
    /// Time of the training steps so far, seconds.
    pub seconds: f64,
    /// Wall-clock time of rendering the trace's views so far, seconds.
    pub evaluation_seconds: f64,
    /// Iterations done.
    pub iteration: u64,
    /// Primitives of the model.
    pub primitives: u64,
    /// Mean PSNR of the novel views in the region, dB.
    pub psnr_db: f64,
    /// Mean PSNR of some input views in the region, dB, if measured in training.
    pub input_psnr_db: Option<f64>,
    /// Objects that move as one, if the model distinguishes any.
    pub objects: Option<u64>,
    /// Mean SSIM of the whole novel views.
    pub ssim: Option<f64>,
    /// Mean LPIPS (`AlexNet`) of the whole novel views, if the network's weights were available.
    pub lpips_alex: Option<f64>,
    /// Opacity-weighted share of the Gaussians in the free space of two input views or more.
    pub ghost_share: Option<f64>,
    /// Share of the pixels of input views with a known distance that are more than half transparent.
    pub input_hole_share: Option<f64>,
    /// The same of novel views.
    pub novel_hole_share: Option<f64>,
}

impl TracedRun {
    /// Returns ghosts, holes of input views and holes of novel views at the end of a run, if distances are known.
    pub(super) fn faults(&self) -> [Option<f64>; 3] {
        self.rows.last().map_or([None; 3], |row| {
            [row.ghost_share, row.input_hole_share, row.novel_hole_share]
        })
    }
}

/// Returns names of runs of one scene for tables and drawings: method and seed; if two share both, their iterations
/// too, and if they share those, their folders.
pub(crate) fn names(runs: &[&TracedRun]) -> Vec<String> {
    let plain = |run: &TracedRun| format!("{}, seed {}", run.method, run.seed);
    let longer = |run: &TracedRun| match run.iterations {
        Some(iterations) => format!("{}, {iterations} iterations", plain(run)),
        None => plain(run),
    };
    let is_alone = |run: &TracedRun, name: &dyn Fn(&TracedRun) -> String| {
        let same = runs.iter().filter(|other| name(other) == name(run));
        same.count() == 1
    };
    let name = |run: &&TracedRun| {
        if is_alone(run, &plain) {
            plain(run)
        } else if is_alone(run, &longer) {
            longer(run)
        } else {
            format!("{} ({})", longer(run), run.folder.display())
        }
    };
    runs.iter().map(name).collect()
}

/// Returns the time of the stages before a run; `None` if none is recorded, or one lacks the clock.
fn preparation_seconds(stages: &[StageTime], clock: Clock) -> Option<f64> {
    let before = stages.iter().filter(|stage| !stage.is_of_run());
    let seconds: Option<Vec<f64>> = before
        .map(|stage| match clock {
            Clock::Wall => Some(stage.took.wall_seconds),
            Clock::Cpu => stage.took.cpu_seconds,
        })
        .collect();
    seconds
        .filter(|all| !all.is_empty())
        .map(|all| all.iter().sum())
}

/// Returns the time of planning and training by a result; 0 without training, `None` if not recorded.
fn training_seconds(record: &ResultRecord, clock: Clock) -> Option<f64> {
    let taken = match clock {
        Clock::Wall => record.training_seconds,
        Clock::Cpu => training_cpu_seconds(&record.stages),
    };
    let takes_none = match record.training_seconds {
        Some(seconds) => seconds <= 0.0,
        None => record.training == Some(TrainingKind::WithoutTraining),
    };
    taken
        .or(takes_none.then_some(0.0))
        .filter(|seconds| seconds.is_finite() && *seconds >= 0.0)
}

/// Returns the CPU time of the stages of planning and training, if every one has its own.
fn training_cpu_seconds(stages: &[StageTime]) -> Option<f64> {
    let is_training = |stage: &&StageTime| stage.is_of_run() && stage.stage != RENDERING;
    let seconds = stages.iter().filter(is_training);
    let seconds: Option<Vec<f64>> = seconds.map(|stage| stage.took.cpu_seconds).collect();
    seconds
        .filter(|all| !all.is_empty())
        .map(|all| all.iter().sum())
}

/// Reads a run from the folder of its scores or the `result.json` there. If the scores have no curve, or one without
/// this region or this clock, the run has no rows: the method does not train, belongs to another program, or left no
/// views along its training.
///
/// # Errors
/// When the result is not complete, or the curve is malformed, goes back in time, or lacks the requested time in some of
/// its rows. Also without rows, if the result lacks a score of novel views in the region.
pub fn read_run(path: &Path, clock: Clock, region: Region) -> Result<TracedRun, BenchError> {
    if path.join(RUN_FILE).is_file() {
        return Err(BenchError::mismatch(
            path,
            "is the folder of a run; a curve is read from the folder of its scores",
        ));
    }
    let file = if path.is_dir() {
        path.join(RESULT_FILE)
    } else {
        path.to_owned()
    };
    let record: ResultRecord = store::read_record(&file)?;
    if let Some(reason) = record.why_incomplete() {
        return Err(BenchError::mismatch(
            &file,
            format!("is not complete: {reason}"),
        ));
    }
    let curve = file.with_file_name(CURVE_FILE);
    let scored = if curve.exists() {
        scored_rows(&curve, clock, region)?
    } else {
        ScoredRows::default()
    };
    let (rows, evaluation_seconds) = (scored.rows, scored.evaluation_seconds);
    let last = rows.last();
    let final_scores = match last {
        Some(last) => FinalScores::of_row(last),
        None => FinalScores::of_result(&file, &record, region)?,
    };
    let training_seconds = match (last, clock) {
        (None, _) => training_seconds(&record, clock),
        (Some(last), Clock::Wall) => Some(record.training_seconds.unwrap_or(last.seconds)),
        (Some(last), Clock::Cpu) => Some(last.seconds),
    };
    Ok(TracedRun {
        folder: path.to_owned(),
        preparation_seconds: preparation_seconds(&record.stages, clock),
        clock,
        region,
        training_seconds,
        evaluation_seconds,
        iterations: record.iterations.or(last.map(|last| last.iteration)),
        primitives: record.primitives.or(last.map(|last| last.primitives)),
        peak_memory_bytes: record.peak_memory_bytes,
        final_scores,
        method: record.method,
        scene: record.scene,
        protocol_hash: record.protocol_hash,
        scene_sha256: record.scene_sha256,
        novel_views: match rows.is_empty() {
            true => (record.novel_views.get(region.psnr_metric()))
                .map_or(0, |summary| summary.views as usize),
            false => scored.novel_views,
        },
        seed: record.seed.unwrap_or_default(),
        rows,
    })
}

/// Rows of a curve with a score in the region.
#[derive(Default)]
struct ScoredRows {
    rows: Vec<TraceRow>,
    /// Time for rendering the views of all rows, seconds.
    evaluation_seconds: f64,
    /// Views of the last row.
    novel_views: usize,
}

/// Reads the rows of a curve; a curve without times of the clock has no such row.
fn scored_rows(curve: &Path, clock: Clock, region: Region) -> Result<ScoredRows, BenchError> {
    let mut rows = Vec::new();
    let (mut evaluation_seconds, mut novel_views) = (0.0, 0);
    let all = read_rows(curve)?;
    let is_timed = clock == Clock::Wall || all.iter().any(|row| row.cpu_seconds.is_some());
    for row in all {
        evaluation_seconds = row.evaluation_seconds;
        let [Some(psnr_db), input_psnr_db] = region.psnr_db(&row) else {
            continue;
        };
        if !is_timed {
            continue;
        }
        let seconds = match clock {
            Clock::Wall => row.wall_seconds,
            Clock::Cpu => row.cpu_seconds.ok_or_else(|| {
                BenchError::mismatch(curve, "has a row without the CPU time of the training")
            })?,
        };
        if !(seconds.is_finite() && psnr_db.is_finite()) {
            return Err(BenchError::mismatch(
                curve,
                format!("iteration {} has a value that is not finite", row.iteration),
            ));
        }
        novel_views = row.novel_views;
        rows.push(TraceRow {
            seconds,
            evaluation_seconds: row.evaluation_seconds,
            iteration: row.iteration,
            primitives: row.primitives,
            psnr_db,
            input_psnr_db,
            objects: row.objects,
            ssim: row.novel_ssim,
            lpips_alex: row.novel_lpips_alex,
            ghost_share: row.ghost_share,
            input_hole_share: row.input_hole_share,
            novel_hole_share: row.novel_hole_share,
        });
    }
    if !rows.is_sorted_by_key(|row| row.seconds) {
        return Err(BenchError::mismatch(curve, "goes back in time"));
    }
    Ok(ScoredRows {
        rows,
        evaluation_seconds,
        novel_views,
    })
}
