//! The curve of a run: its novel views at the rows of its trace, scored like predictions, by the protocol's own PSNR,
//! SSIM and LPIPS. If the scene has masks, also the PSNR of moving content and of the rest.
//!
//! LPIPS uses `AlexNet`: VGG takes ten times as long, and a curve has many more views than a result.

use std::path::Path;

use omnilife_schemas::{layout::CURVE_FILE, progress::Progress, rgb::Mask, store};
use rayon::prelude::*;

use crate::{
    curve::rows::CurveRow,
    error::BenchError,
    job::{ScoringJob, ViewKind},
    memory,
    metrics::{Metric, Sample, Undefined},
    prediction::PredictionFolder,
    summary, truth,
};

const LPIPS: &str = "lpips-alex";

struct CurveMetric {
    /// Its id in [`crate::metrics::METRICS`].
    id: &'static str,
    column: fn(&mut CurveRow) -> &mut Option<f64>,
}

/// Metrics of a curve; a protocol without them has none.
const CURVE_METRICS: [CurveMetric; 5] = [
    CurveMetric {
        id: "psnr",
        column: |row| &mut row.novel_psnr_db,
    },
    CurveMetric {
        id: "ssim",
        column: |row| &mut row.novel_ssim,
    },
    CurveMetric {
        id: LPIPS,
        column: |row| &mut row.novel_lpips_alex,
    },
    CurveMetric {
        id: "psnr-static",
        column: |row| &mut row.novel_psnr_static_db,
    },
    CurveMetric {
        id: "psnr-dynamic",
        column: |row| &mut row.novel_psnr_dynamic_db,
    },
];

/// Scores the novel views at the rows of the run's trace and writes [`CURVE_FILE`] into `out`. Returns one line for
/// every row that could not be scored, and one if LPIPS could not be computed. `None`, and no file, if the run has no
/// such views or the protocol scores none.
///
/// # Errors
/// When a ground truth image is unusable or the file cannot be written.
pub(super) fn write_curve(
    job: &ScoringJob,
    memory_bytes: u64,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Option<Vec<String>>, BenchError> {
    let trace = job.run.as_ref().and_then(|run| run.trace.as_ref());
    let (Some(trace), Some(_)) = (trace, job.folder(ViewKind::Novel)) else {
        return Ok(None);
    };
    let mut metrics: Vec<&Metric> = job.computed().collect();
    metrics.retain(|metric| {
        CURVE_METRICS
            .iter()
            .any(|of_curve| of_curve.id == metric.id)
    });
    let folders = trace
        .folders
        .iter()
        .map(|folder| PredictionFolder::open(folder, &trace.frames))
        .collect::<Vec<_>>();
    let label = format!("scoring the curve of {} on {}", job.method, job.scene.id);
    progress.begin(&label, Some(trace.frames.len() as u64));
    let mut scores: Vec<Vec<ViewScores>> = vec![Vec::new(); trace.rows.len()];
    for frames in trace
        .frames
        .chunks(memory::views_together(job, memory_bytes))
    {
        let of_frames = frames
            .par_iter()
            .map(|&frame| {
                let truth = truth::read(job, frame)?;
                let ignored = truth::read_ignore_mask(job, frame)?;
                let dynamic = truth::read_dynamic_mask(job, frame)?;
                let truth = OfFrame {
                    image: &truth,
                    ignored: ignored.as_ref(),
                    dynamic: dynamic.as_ref(),
                };
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
            progress.advance(1);
        }
    }
    progress.end();
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
    if let Some(line) = without_lpips(job, &rows) {
        progress.note(&line);
        unscored.push(line);
    }
    store::write_csv_rows(&out.join(CURVE_FILE), &rows)?;
    Ok(Some(unscored))
}

/// Returns a line on why the curve has no LPIPS, if the protocol has it.
fn without_lpips(job: &ScoringJob, rows: &[CurveRow]) -> Option<String> {
    let lpips = job.metrics.iter().find(|one| one.metric.id == LPIPS)?;
    if rows.iter().any(|row| row.novel_lpips_alex.is_some()) {
        return None;
    }
    let reason = lpips.unavailable.as_deref();
    let reason = reason.unwrap_or("it is undefined for every view");
    Some(format!("the curve has no {LPIPS}: {reason}"))
}

/// One value per metric, or the reason why the view cannot be scored.
type ViewScores = Result<Vec<Result<f64, Undefined>>, String>;

/// The scene's data of a frame.
struct OfFrame<'a> {
    image: &'a [u8],
    ignored: Option<&'a Mask>,
    dynamic: Option<&'a Mask>,
}

fn score_view(
    job: &ScoringJob,
    folder: &PredictionFolder,
    frame: u32,
    truth: &OfFrame<'_>,
    metrics: &[&Metric],
) -> ViewScores {
    let [width, height] = job.size;
    let prediction = folder.read(frame, width, height)?;
    let pair = truth::pair(job, prediction, truth.image.to_vec(), truth.ignored)
        .ok_or("images differ in size")?;
    let mut sample = Sample::new(&pair);
    sample.dynamic = truth.dynamic;
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
        for of_curve in CURVE_METRICS.iter().filter(|one| one.id == metric.id) {
            *(of_curve.column)(row) = mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::METRICS;

    #[test]
    fn metrics_of_a_curve_are_metrics() {
        for of_curve in CURVE_METRICS {
            let mut all = METRICS.iter();
            assert!(
                all.any(|metric| metric.id == of_curve.id),
                "{}",
                of_curve.id
            );
        }
    }
}
