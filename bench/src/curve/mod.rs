//! Error against run time: from the novel views along a training to its curve, and from curves to
//! time-to-quality tables, drawings and the Pareto front.
//!
//! Time, on the wall's clock or the CPU's, is that of the training steps alone; how long the
//! views along it took to render is reported beside it. Quality is the mean PSNR of the novel views at a
//! row of the trace, by the metric that scores the predictions. Runs
//! are compared where scene and protocol are the same.

mod measures;
pub(crate) mod rows;
pub(crate) mod scored;
mod trace;

use std::{
    fmt::Write,
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{stage::StagePlan, store};
use serde::Serialize;

use crate::{
    chart::{self, Series, Titles},
    error::BenchError,
};
pub use measures::{MOMENTS_SECONDS, QUALITIES_DB, RunCurve, curve_of};
pub use scored::CURVE_FILE;
pub use trace::{Clock, Region, TraceRow, TracedRun, read_run};

/// One row per run: time to quality, quality after a time, area under the curve.
pub const CURVES_FILE: &str = "curves.csv";
/// One row per row of a trace.
pub const POINTS_FILE: &str = "points.csv";

/// Runs of one scene and protocol, measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Id of the scene.
    pub scene: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// The runs in the order in which they were given.
    pub curves: Vec<RunCurve>,
}

/// Reads runs (the folders of their scores, or the `result.json` there), compares those of one scene and protocol, and writes
/// `curves.csv`, `points.csv` and one `curve-<n>.svg` per comparison into `out`.
///
/// # Errors
/// When a run has no curve or no scores of novel views in it, a file that is not ours is in the way,
/// or a file cannot be read or written.
pub fn curves(
    runs: &[PathBuf],
    clock: Clock,
    region: Region,
    out: &Path,
) -> Result<Vec<Comparison>, BenchError> {
    let mut groups: Vec<((String, String), Vec<TracedRun>)> = Vec::new();
    for path in runs {
        let run = read_run(path, clock, region)?;
        let key = (run.scene.clone(), run.protocol_hash.clone());
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, runs)) => runs.push(run),
            None => groups.push((key, vec![run])),
        }
    }
    let drawings = (0..groups.len()).map(drawing_file);
    let files: Vec<String> = [CURVES_FILE, POINTS_FILE]
        .map(str::to_owned)
        .into_iter()
        .chain(drawings)
        .collect();
    store::create_folder(out)?;
    let begun = Instant::now();
    let stage = StagePlan::new(out, "curves");
    stage.claim(&files)?;
    stage
        .own_files()
        .remove(|file| !files.iter().any(|new| new == file))?;
    let mut comparisons = Vec::new();
    for (number, ((scene, protocol_hash), runs)) in groups.iter().enumerate() {
        let path = out.join(drawing_file(number));
        let drawing = drawing(scene, (clock, region), runs)
            .map_err(|reason| BenchError::internal(&path, reason))?;
        store::write_bytes(&path, drawing.as_bytes())?;
        comparisons.push(Comparison {
            scene: scene.clone(),
            protocol_hash: protocol_hash.clone(),
            curves: measures::measured(runs),
        });
    }
    write_curves(&out.join(CURVES_FILE), &comparisons)?;
    write_points(&out.join(POINTS_FILE), &groups)?;
    stage.finish(&files, begun.elapsed().as_secs_f64())?;
    Ok(comparisons)
}

fn drawing_file(number: usize) -> String {
    format!("curve-{number}.svg")
}

fn drawing(
    scene: &str,
    (clock, region): (Clock, Region),
    runs: &[TracedRun],
) -> Result<String, String> {
    let names = trace::names(&runs.iter().collect::<Vec<_>>());
    let series: Vec<Series> = runs
        .iter()
        .zip(names)
        .map(|(run, name)| Series {
            name,
            points: run
                .rows
                .iter()
                .filter(|row| row.seconds > 0.0)
                .map(|row| (row.seconds, row.psnr_db))
                .collect(),
        })
        .collect();
    let titles = Titles {
        chart: scene,
        x: match clock {
            Clock::Wall => "training time, s",
            Clock::Cpu => "training time, CPU seconds",
        },
        y: match region {
            Region::Whole => "PSNR of novel views, dB",
            Region::Static => "PSNR of novel views where nothing moves, dB",
            Region::Dynamic => "PSNR of novel views where something moves, dB",
        },
    };
    chart::over_log_x(&titles, &series)
}

fn cell(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value}"))
}

fn write_curves(path: &Path, comparisons: &[Comparison]) -> Result<(), BenchError> {
    store::write_csv(path, |table| {
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
            "on_pareto_front",
            "area_seconds",
            "area_db",
            "seconds_to_95_percent",
            "iterations_to_95_percent",
        ]
        .map(str::to_owned)
        .into();
        for quality in QUALITIES_DB {
            header.push(format!("seconds_to_{quality}_db"));
            header.push(format!("iterations_to_{quality}_db"));
        }
        header.extend(MOMENTS_SECONDS.map(|seconds| format!("psnr_db_at_{seconds}_s")));
        header.extend(["ghost_share", "input_hole_share", "novel_hole_share"].map(str::to_owned));
        table.write_record(&header)?;
        for comparison in comparisons {
            for curve in &comparison.curves {
                let run = &curve.run;
                let mut row = vec![
                    comparison.scene.clone(),
                    comparison.protocol_hash.clone(),
                    run.method.clone(),
                    run.seed.to_string(),
                    run.clock.name().to_owned(),
                    run.region.name().to_owned(),
                    cell(run.preparation_seconds),
                    run.training_seconds.to_string(),
                    run.evaluation_seconds.to_string(),
                    run.iterations.to_string(),
                    run.primitives.to_string(),
                    run.peak_memory_bytes
                        .map_or(String::new(), |bytes| bytes.to_string()),
                    curve.final_db.to_string(),
                    curve.on_front.to_string(),
                    curve.area_seconds.to_string(),
                    cell(curve.area_db),
                ];
                for reached in std::iter::once(&curve.to_95_percent).chain(&curve.to_quality) {
                    row.push(cell(reached.map(|reached| reached.seconds)));
                    row.push(reached.map_or(String::new(), |r| r.iteration.to_string()));
                }
                row.extend(curve.at_moment.iter().map(|&value| cell(value)));
                row.extend(faults(run).map(cell));
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
    seconds: f64,
    evaluation_seconds: f64,
    iteration: u64,
    primitives: u64,
    psnr_db: f64,
    input_psnr_db: Option<f64>,
    objects: Option<u64>,
    ssim: Option<f64>,
    ghost_share: Option<f64>,
    input_hole_share: Option<f64>,
    novel_hole_share: Option<f64>,
}

fn write_points(
    path: &Path,
    groups: &[((String, String), Vec<TracedRun>)],
) -> Result<(), BenchError> {
    store::write_csv(path, |table| {
        for run in groups.iter().flat_map(|(_, runs)| runs) {
            for row in &run.rows {
                let row = PointRow {
                    scene: &run.scene,
                    protocol_hash: &run.protocol_hash,
                    method: &run.method,
                    seed: run.seed,
                    clock: run.clock.name(),
                    region: run.region.name(),
                    seconds: row.seconds,
                    evaluation_seconds: row.evaluation_seconds,
                    iteration: row.iteration,
                    primitives: row.primitives,
                    psnr_db: row.psnr_db,
                    input_psnr_db: row.input_psnr_db,
                    objects: row.objects,
                    ssim: row.ssim,
                    ghost_share: row.ghost_share,
                    input_hole_share: row.input_hole_share,
                    novel_hole_share: row.novel_hole_share,
                };
                table.serialize(row)?;
            }
        }
        Ok(())
    })?;
    Ok(())
}

/// Ghosts, holes of input views and holes of novel views at the end of a run, where distances are known.
fn faults(run: &TracedRun) -> [Option<f64>; 3] {
    let last = run.rows.last();
    last.map_or([None; 3], |row| {
        [row.ghost_share, row.input_hole_share, row.novel_hole_share]
    })
}

/// The comparisons as Markdown tables.
pub fn curves_table(comparisons: &[Comparison]) -> String {
    let mut text = String::new();
    for comparison in comparisons {
        let with_faults = |curve: &RunCurve| faults(&curve.run).iter().any(Option::is_some);
        let with_faults = comparison.curves.iter().any(with_faults);
        let (fault_heads, fault_rules) = if with_faults {
            (
                " Ghosts % | Holes %, input | Holes %, novel |",
                " ---: | ---: | ---: |",
            )
        } else {
            ("", "")
        };
        let with_preparation =
            (comparison.curves.iter()).any(|curve| curve.run.preparation_seconds.is_some());
        let (preparation_head, preparation_rule) = if with_preparation {
            (" Before training s |", " ---: |")
        } else {
            ("", "")
        };
        let _ = writeln!(
            text,
            "{}, protocol {:.12}{}{}\n\n| Run | Final dB | 95 % after s | {} | {} | Area dB | GiB | \
             Front |{preparation_head}{fault_heads}\n| --- | ---: | ---: | {} ---: | ---: | --- |\
             {preparation_rule}{fault_rules}",
            comparison.scene,
            comparison.protocol_hash,
            match comparison.curves.first().map(|curve| curve.run.clock) {
                Some(Clock::Cpu) => ", CPU seconds",
                _ => "",
            },
            match comparison.curves.first().map(|curve| curve.run.region) {
                Some(Region::Static) => ", where nothing moves",
                Some(Region::Dynamic) => ", where something moves",
                _ => "",
            },
            QUALITIES_DB
                .map(|db| format!("{db} dB after s"))
                .join(" | "),
            MOMENTS_SECONDS.map(|s| format!("dB at {s} s")).join(" | "),
            "---: | ".repeat(QUALITIES_DB.len() + MOMENTS_SECONDS.len()),
        );
        let runs: Vec<&TracedRun> = comparison.curves.iter().map(|curve| &curve.run).collect();
        for (curve, name) in comparison.curves.iter().zip(trace::names(&runs)) {
            let number = |value: Option<f64>, digits: usize| {
                value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
            };
            let mut cells = vec![
                name,
                number(Some(curve.final_db), 3),
                number(curve.to_95_percent.map(|reached| reached.seconds), 1),
            ];
            let seconds = |reached: &Option<measures::Reached>| reached.map(|r| r.seconds);
            cells.extend(curve.to_quality.iter().map(|r| number(seconds(r), 1)));
            cells.extend(curve.at_moment.iter().map(|&db| number(db, 3)));
            cells.push(number(curve.area_db, 3));
            let bytes = curve.run.peak_memory_bytes;
            cells.push(number(bytes.map(|b| b as f64 / f64::from(1 << 30)), 2));
            cells.push(if curve.on_front { "yes" } else { "" }.to_owned());
            if with_preparation {
                cells.push(number(curve.run.preparation_seconds, 1));
            }
            if with_faults {
                let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 2);
                cells.extend(faults(&curve.run).map(percent));
            }
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text.push('\n');
    }
    text
}
