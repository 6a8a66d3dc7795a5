//! Cost against size: CPU milliseconds per stage of a training iteration, over the numbers of Gaussians and of
//! pixels. Each stage has its slope in a log-log plot.
//!
//! Writes `scaling.csv` (one row per size and stage) and `scaling.svg` (whole iterations) into the
//! folder and prints the slopes. A slope above 1 is a stage that grows faster than its input.

use std::{error::Error, fs, path::Path};

use omnilife_engine::render::settings::RenderSettings;
use plotters::prelude::*;

use crate::iteration::Iteration;

const COUNTS: [usize; 5] = [10_000, 30_000, 100_000, 300_000, 1_000_000];
const WIDTHS: [u32; 4] = [256, 512, 1024, 2048];
/// Pixels where Gaussians vary, and Gaussians where pixels vary.
const FIXED: (u32, usize) = (512, 50_000);
const WARM_UP: usize = 1;
const ROUNDS: usize = 4;

/// Cost of one size.
struct Measurement {
    series: &'static str,
    /// Gaussians or pixels, whichever varies.
    size: f64,
    /// Stage and its CPU seconds, the fastest of [`ROUNDS`]; the whole iteration is last.
    stages: Vec<(&'static str, f64)>,
}

/// Measures all sizes, writes table and figure into `folder` and prints the slopes.
pub(crate) fn run(folder: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let mut measurements = Vec::new();
    for count in COUNTS {
        measurements.push(measure("Gaussians", count as f64, count, FIXED.0));
    }
    for width in WIDTHS {
        let pixels = f64::from(width) * f64::from(width / 2);
        measurements.push(measure("pixels", pixels, FIXED.1, width));
    }
    write_csv(folder, &measurements)?;
    for series in ["Gaussians", "pixels"] {
        print_slopes(series, &measurements);
    }
    plot(&folder.join("scaling.svg"), &measurements)
}

fn measure(series: &'static str, size: f64, count: usize, width: u32) -> Measurement {
    let mut iteration = Iteration::new(count, width, RenderSettings::new(0.01));
    let mut stages: Vec<(&'static str, f64)> = Vec::new();
    let mut whole = f64::INFINITY;
    for round in 0..WARM_UP + ROUNDS {
        let (mut stage, mut sum) = (0, 0.0);
        iteration.run(|name, seconds| {
            sum += seconds;
            match stages.get_mut(stage) {
                Some(best) if round > WARM_UP => best.1 = best.1.min(seconds),
                Some(best) => best.1 = seconds,
                None => stages.push((name, seconds)),
            }
            stage += 1;
        });
        if round >= WARM_UP {
            whole = whole.min(sum);
        }
    }
    stages.push(("iteration", whole));
    Measurement {
        series,
        size,
        stages,
    }
}

fn write_csv(folder: &Path, measurements: &[Measurement]) -> Result<(), Box<dyn Error>> {
    let mut csv = csv::Writer::from_path(folder.join("scaling.csv"))?;
    csv.write_record(["varied", "size", "stage", "processor_seconds"])?;
    for measurement in measurements {
        for (stage, seconds) in &measurement.stages {
            csv.write_record([
                measurement.series,
                &measurement.size.to_string(),
                stage,
                &format!("{seconds:.6}"),
            ])?;
        }
    }
    csv.flush()?;
    Ok(())
}

fn of_series<'a>(
    series: &'a str,
    measurements: &'a [Measurement],
) -> impl Iterator<Item = &'a Measurement> {
    measurements
        .iter()
        .filter(move |measurement| measurement.series == series)
}

/// Prints the slope of the straight line through the logarithms, for each stage.
fn print_slopes(series: &str, measurements: &[Measurement]) {
    println!(
        "| stage | first, ms | last, ms | slope over {series} | steepest step |\n|---|---:|---:|---:|---:|"
    );
    let names: Vec<&str> = of_series(series, measurements)
        .next()
        .map(|first| first.stages.iter().map(|(name, _)| *name).collect())
        .unwrap_or_default();
    for (index, name) in names.iter().enumerate() {
        let points: Vec<(f64, f64)> = of_series(series, measurements)
            .map(|measurement| (measurement.size.ln(), measurement.stages[index].1.ln()))
            .collect();
        let steepest = points
            .windows(2)
            .map(|pair| (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0))
            .fold(f64::NEG_INFINITY, f64::max);
        let ends = [points[0].1, points[points.len() - 1].1].map(|log| log.exp() * 1e3);
        println!(
            "| {name} | {:.2} | {:.2} | {:.2} | {steepest:.2} |",
            ends[0],
            ends[1],
            slope(&points)
        );
    }
    println!();
}

fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let variance: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    covariance / variance
}

/// Writes two log-log plots side by side: whole iterations over Gaussians and over pixels.
fn plot(path: &Path, measurements: &[Measurement]) -> Result<(), Box<dyn Error>> {
    let area = SVGBackend::new(path, (900, 360)).into_drawing_area();
    area.fill(&WHITE)?;
    for (part, series) in area
        .split_evenly((1, 2))
        .iter()
        .zip(["Gaussians", "pixels"])
    {
        let points: Vec<(f64, f64)> = of_series(series, measurements)
            .filter_map(|m| m.stages.last().map(|(_, seconds)| (m.size, seconds * 1e3)))
            .collect();
        let bounds = |values: Vec<f64>| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(0.0, f64::max);
            (low / 1.5..high * 1.5).log_scale()
        };
        let mut chart = ChartBuilder::on(part)
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(56)
            .build_cartesian_2d(
                bounds(points.iter().map(|point| point.0).collect()),
                bounds(points.iter().map(|point| point.1).collect()),
            )?;
        chart
            .configure_mesh()
            .x_desc(series)
            .y_desc("CPU ms per iteration")
            .draw()?;
        chart.draw_series(LineSeries::new(points.iter().copied(), &BLUE))?;
        chart.draw_series(
            points
                .iter()
                .map(|&point| Circle::new(point, 3, BLUE.filled())),
        )?;
    }
    area.present()?;
    Ok(())
}
