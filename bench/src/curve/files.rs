//! The files of compared curves: `curves.csv` with a row per run, `points.csv` with a row per row of a trace.

use std::path::Path;

use omnilife_schemas::store;
use serde::Serialize;

use super::{
    Comparison,
    measures::{BELOW_END_DB, MOMENTS_SECONDS, QUALITIES_DB},
    trace::TracedRun,
};
use crate::error::BenchError;

/// One row per run: time to quality, quality after a time, area under the curve.
pub const CURVES_FILE: &str = "curves.csv";
/// One row per row of a trace; of a run without a trace its end.
pub const POINTS_FILE: &str = "points.csv";

fn cell(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

fn curves_header() -> Vec<String> {
    let mut header: Vec<String> = [
        "scene",
        "protocol_hash",
        "method",
        "seed",
        "clock",
        "region",
        "preparation_seconds",
        "training_seconds",
        "evaluation_seconds",
        "iterations",
        "primitives",
        "peak_memory_bytes",
        "final_psnr_db",
        "final_ssim",
        "final_lpips_alex",
        "on_pareto_front",
        "first_seconds",
        "first_psnr_db",
        "log_area_from_seconds",
        "log_area_until_seconds",
        "log_area_db",
        "log_area_ssim",
        "log_area_lpips_alex",
    ]
    .map(str::to_owned)
    .into();
    for below in BELOW_END_DB {
        header.push(format!("seconds_to_{below}_db_below_end"));
        header.push(format!("iterations_to_{below}_db_below_end"));
    }
    for quality in QUALITIES_DB {
        header.push(format!("seconds_to_{quality}_db"));
        header.push(format!("iterations_to_{quality}_db"));
    }
    header.extend(MOMENTS_SECONDS.map(|seconds| format!("psnr_db_at_{seconds}_s")));
    header.extend(["ghost_share", "input_hole_share", "novel_hole_share"].map(str::to_owned));
    header
}

pub(super) fn write_curves(path: &Path, comparisons: &[Comparison]) -> Result<(), BenchError> {
    store::write_csv(path, |table| {
        table.write_record(curves_header())?;
        for comparison in comparisons {
            for curve in &comparison.curves {
                let run = &curve.run;
                let first = run.rows.first();
                let span = comparison.span.filter(|_| curve.log_area_db.is_some());
                let mut row = vec![
                    comparison.scene.clone(),
                    comparison.protocol_hash.clone(),
                    run.method.clone(),
                    run.seed.to_string(),
                    run.clock.name().to_owned(),
                    run.region.name().to_owned(),
                    cell(run.preparation_seconds),
                    cell(run.training_seconds),
                    run.evaluation_seconds.to_string(),
                    cell(run.iterations),
                    cell(run.primitives),
                    cell(run.peak_memory_bytes),
                    run.final_scores.psnr_db.to_string(),
                    cell(run.final_scores.ssim),
                    cell(run.final_scores.lpips_alex),
                    curve.on_front.to_string(),
                    cell(first.map(|row| row.seconds)),
                    cell(first.map(|row| row.psnr_db)),
                    cell(span.map(|span| span.from_seconds)),
                    cell(span.map(|span| span.until_seconds)),
                    cell(curve.log_area_db),
                    cell(curve.log_area_ssim),
                    cell(curve.log_area_lpips_alex),
                ];
                for crossing in curve.to_own_end.iter().chain(&curve.to_quality) {
                    row.push(cell(crossing.seconds()));
                    row.push(cell(crossing.iteration()));
                }
                row.extend(curve.at_moment.iter().map(|&value| cell(value)));
                row.extend(run.faults().map(cell));
                table.write_record(&row)?;
            }
        }
        Ok(())
    })?;
    Ok(())
}

#[derive(Serialize)]
struct PointRow<'a> {
    scene: &'a str,
    protocol_hash: &'a str,
    method: &'a str,
    seed: u64,
    clock: &'a str,
    region: &'a str,
    seconds: Option<f64>,
    evaluation_seconds: f64,
    iteration: Option<u64>,
    primitives: Option<u64>,
    psnr_db: f64,
    input_psnr_db: Option<f64>,
    objects: Option<u64>,
    ssim: Option<f64>,
    lpips_alex: Option<f64>,
    ghost_share: Option<f64>,
    input_hole_share: Option<f64>,
    novel_hole_share: Option<f64>,
}

impl<'a> PointRow<'a> {
    fn of_end(run: &'a TracedRun) -> Self {
        Self {
            scene: &run.scene,
            protocol_hash: &run.protocol_hash,
            method: &run.method,
            seed: run.seed,
            clock: run.clock.name(),
            region: run.region.name(),
            seconds: run.training_seconds,
            evaluation_seconds: run.evaluation_seconds,
            iteration: run.iterations,
            primitives: run.primitives,
            psnr_db: run.final_scores.psnr_db,
            input_psnr_db: None,
            objects: None,
            ssim: run.final_scores.ssim,
            lpips_alex: run.final_scores.lpips_alex,
            ghost_share: None,
            input_hole_share: None,
            novel_hole_share: None,
        }
    }
}

pub(super) fn write_points<'a>(
    path: &Path,
    runs: impl Iterator<Item = &'a TracedRun>,
) -> Result<(), BenchError> {
    store::write_csv(path, |table| {
        for run in runs {
            if run.rows.is_empty() {
                table.serialize(PointRow::of_end(run))?;
            }
            for row in &run.rows {
                let row = PointRow {
                    seconds: Some(row.seconds),
                    evaluation_seconds: row.evaluation_seconds,
                    iteration: Some(row.iteration),
                    primitives: Some(row.primitives),
                    psnr_db: row.psnr_db,
                    input_psnr_db: row.input_psnr_db,
                    objects: row.objects,
                    ssim: row.ssim,
                    lpips_alex: row.lpips_alex,
                    ghost_share: row.ghost_share,
                    input_hole_share: row.input_hole_share,
                    novel_hole_share: row.novel_hole_share,
                    ..PointRow::of_end(run)
                };
                table.serialize(row)?;
            }
        }
        Ok(())
    })?;
    Ok(())
}
