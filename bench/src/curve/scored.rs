//! The curve of a run: the novel views that it left at the rows of its trace, scored as predictions
//! are, by the protocol's own PSNR and SSIM.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    records::RunRecord,
    store::{self, StoreError},
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    error::BenchError,
    memory,
    metrics::{Metric, Sample, Undefined, ViewPair},
    prediction::PredictionFolder,
    scoring::job::{ScoringJob, ViewKind},
    summary, truth,
};

/// File name of the curve in the folder of a run's scores.
pub const CURVE_FILE: &str = "curve.csv";

/// Metrics of a curve; a protocol without them has none.
const METRICS: [&str; 2] = ["psnr", "ssim"];

/// One row of a curve: where training stood, and how good the novel views were.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct CurveRow {
    /// Wall-clock time of the training steps so far.
    pub(crate) wall_seconds: f64,
    /// Wall-clock time of rendering the rows' views so far.
    pub(crate) evaluation_seconds: f64,
    /// CPU time of the training steps so far, where the system tells.
    pub(crate) cpu_seconds: Option<f64>,
    /// Iterations done.
    pub(crate) iteration: u64,
    /// Primitives of the model.
    #[serde(alias = "gaussians")]
    pub(crate) primitives: u64,
    /// Novel views that were scored; a trace has none of them.
    #[serde(default)]
    pub(crate) novel_views: usize,
    /// Mean PSNR of these views, dB; none where one could not be scored.
    #[serde(default)]
    pub(crate) novel_psnr_db: Option<f64>,
    /// Mean SSIM of these views; as PSNR.
    #[serde(default)]
    pub(crate) novel_ssim: Option<f64>,
}

/// A trace with the views at its rows.
pub(crate) struct Trace {
    file: PathBuf,
    rows: Vec<CurveRow>,
    /// One per row: where its views are.
    folders: Vec<PathBuf>,
    /// The frames that are there at every row.
    frames: Vec<u32>,
}

impl Trace {
    /// The trace of a run; `None` where the run left none, or no views.
    ///
    /// # Errors
    /// When the trace is malformed.
    pub(crate) fn of_run(file: &Path, run: &RunRecord) -> Result<Option<Self>, BenchError> {
        let (Some(trace), Some(views)) = (&run.trace, &run.trace_views) else {
            return Ok(None);
        };
        if views.frames.is_empty() {
            return Ok(None);
        }
        let trace = file.with_file_name(trace);
        let rows = read_rows(&trace)?;
        let folder = |row: &CurveRow| {
            file.with_file_name(if row.iteration == run.iterations {
                run.predictions.novel_views.clone()
            } else {
                format!("{}/{:06}", views.folder, row.iteration)
            })
        };
        Ok(Some(Self {
            folders: rows.iter().map(folder).collect(),
            rows,
            frames: views.frames.clone(),
            file: trace,
        }))
    }

    /// The trace, and the views at its rows: everything that a curve depends on.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> + '_ {
        let views = self.folders.iter().flat_map(|folder| {
            let file = |frame: &u32| folder.join(format!("{frame:06}.png"));
            self.frames.iter().map(file)
        });
        std::iter::once(self.file.clone()).chain(views)
    }
}

/// Reads the rows of a trace or a curve.
pub(crate) fn read_rows(path: &Path) -> Result<Vec<CurveRow>, BenchError> {
    let text = std::fs::read(path).map_err(|source| StoreError::read(path, source))?;
    csv::Reader::from_reader(text.as_slice())
        .deserialize()
        .map(|row| row.map_err(|error| BenchError::mismatch(path, error.to_string())))
        .collect()
}

/// Scores the novel views at the rows of the run's trace and writes [`CURVE_FILE`] into `out`.
/// Returns one line for every row that could not be scored; `None`, and no file, where the run has no
/// such views or the protocol scores none.
///
/// # Errors
/// When a ground truth image is unusable or the file cannot be written.
pub(crate) fn write_curve(
    job: &ScoringJob,
    memory_bytes: u64,
    out: &Path,
) -> Result<Option<Vec<String>>, BenchError> {
    let trace = job.run.as_ref().and_then(|run| run.trace.as_ref());
    let (Some(trace), Some(_)) = (trace, job.folder(ViewKind::Novel)) else {
        return Ok(None);
    };
    let mut metrics: Vec<&Metric> = job.computed().collect();
    metrics.retain(|metric| METRICS.contains(&metric.id));
    let folders = trace
        .folders
        .iter()
        .map(|folder| PredictionFolder::open(folder, &trace.frames))
        .collect::<Vec<_>>();
    let mut scores: Vec<Vec<ViewScores>> = vec![Vec::new(); trace.rows.len()];
    for frames in trace
        .frames
        .chunks(memory::views_together(job, memory_bytes))
    {
        let of_frames = frames
            .par_iter()
            .map(|&frame| {
                let truth = truth::read(job, frame)?;
                let folders = folders.iter();
                Ok(folders
                    .map(|folder| match folder {
                        Ok(folder) => score_view(job, folder, frame, &truth, &metrics),
                        Err(error) => Err(error.to_string()),
                    })
                    .collect())
            })
            .collect::<Vec<Result<Vec<ViewScores>, BenchError>>>();
        for of_frame in of_frames {
            for (row, view) in scores.iter_mut().zip(of_frame?) {
                row.push(view);
            }
        }
    }
    let mut unscored = Vec::new();
    let mut rows = trace.rows.clone();
    for (row, views) in rows.iter_mut().zip(scores) {
        match views.into_iter().collect::<Result<Vec<_>, _>>() {
            Ok(views) => fill(row, &metrics, &views),
            Err(reason) => unscored.push(format!(
                "the curve has no score at iteration {}: {reason}",
                row.iteration
            )),
        }
    }
    store::write_with(&out.join(CURVE_FILE), |writer| {
        let mut table = csv::Writer::from_writer(writer);
        for row in &rows {
            table.serialize(row).map_err(std::io::Error::other)?;
        }
        table.flush()
    })?;
    Ok(Some(unscored))
}

/// One value per metric, or why the view cannot be scored.
type ViewScores = Result<Vec<Result<f64, Undefined>>, String>;

fn score_view(
    job: &ScoringJob,
    folder: &PredictionFolder,
    frame: u32,
    truth: &[u8],
    metrics: &[&Metric],
) -> ViewScores {
    let [width, height] = job.size;
    let prediction = folder.read(frame, width, height)?;
    let pair = ViewPair::new(width as usize, height as usize, prediction, truth.to_vec())
        .ok_or("images differ in size")?;
    let sample = Sample::new(&pair);
    Ok(metrics
        .iter()
        .map(|metric| (metric.function)(&sample))
        .collect())
}

/// Puts the means over the views into a row.
fn fill(row: &mut CurveRow, metrics: &[&Metric], views: &[Vec<Result<f64, Undefined>>]) {
    row.novel_views = views.len();
    for (index, metric) in metrics.iter().enumerate() {
        let values: Vec<_> = views.iter().map(|view| view[index]).collect();
        let mean = summary::summary(metric, &values).ok();
        let mean = mean.map(|summary| summary.mean);
        match metric.id {
            "psnr" => row.novel_psnr_db = mean,
            _ => row.novel_ssim = mean,
        }
    }
}
