//! Curves as drawings: a line per run with a trace, a point for a run with only a training time, a level across the
//! chart for one without.

use omnilife_charts::{ChartError, SIZE, Series, Titles, decades_of, over_log_x};

use super::{
    Clock, Region,
    trace::{self, TracedRun},
};

/// Time of a chart without any time, seconds.
const ANY_SECONDS: [f64; 2] = [1.0, 10.0];

pub(super) fn of_runs(
    scene: &str,
    (clock, region): (Clock, Region),
    runs: &[TracedRun],
) -> Result<String, ChartError> {
    let points: Vec<Vec<(f64, f64)>> = runs.iter().map(timed_points).collect();
    let across = decades_of(points.iter().flatten().map(|point| point.0));
    let across = across.unwrap_or(ANY_SECONDS);
    let names = trace::names(&runs.iter().collect::<Vec<_>>());
    let series: Vec<Series> = runs
        .iter()
        .zip(points)
        .zip(names)
        .map(|((run, points), name)| {
            if points.is_empty() {
                level(run, &name, across)
            } else {
                Series { name, points }
            }
        })
        .collect();
    let titles = Titles {
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
    over_log_x(SIZE, scene, &titles, &series)
}

/// Returns the rows of a run, or its end, at times that a logarithmic axis can show.
fn timed_points(run: &TracedRun) -> Vec<(f64, f64)> {
    let rows = run.rows.iter().map(|row| (row.seconds, row.psnr_db));
    let end = run.training_seconds.filter(|_| run.rows.is_empty());
    let end = end.map(|seconds| (seconds, run.final_scores.psnr_db));
    rows.chain(end).filter(|point| point.0 > 0.0).collect()
}

/// Returns a run without a time: the same quality at every time.
fn level(run: &TracedRun, name: &str, across: [f64; 2]) -> Series {
    let reason = match run.training_seconds {
        Some(_) => "without training",
        None => "time not known",
    };
    Series {
        name: format!("{name}, {reason}"),
        points: across
            .map(|seconds| (seconds, run.final_scores.psnr_db))
            .into(),
    }
}
