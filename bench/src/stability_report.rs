//! The stability report for people: all rows as CSV, a page of the worst of them, and the errors of stiff
//! cases over their condition number.
//!
//! This crate only reports; the cases are run next to the kernels.

mod page;
mod rows;

use std::path::Path;

use omnilife_charts::{ChartError, SIZE, Series, Titles, log_log};
use omnilife_schemas::{
    progress::Progress,
    records::{StabilityMeasures, StabilityReport, StabilityStatus, StabilitySweep},
    stage::StagePlan,
};

use crate::error::BenchError;

pub use page::stability_page;

/// The whole report.
pub const STABILITY_FILE: &str = "stability.json";
/// All rows.
pub const STABILITY_TABLE: &str = "stability.csv";
/// The page for people.
pub const STABILITY_PAGE: &str = "stability.md";

/// Errors below this are drawn at it: 0 has no place on a logarithmic axis.
const SMALLEST_ERROR: f64 = 1e-9;

/// Writes `stability.json`, `stability.csv`, `stability.md` and `stability-<sweep>.svg` into a folder, which
/// is made where it is missing.
///
/// # Errors
/// When a foreign file is in the way, or one cannot be written.
pub fn write_stability(
    report: &StabilityReport,
    out: &Path,
    progress: &dyn Progress,
) -> Result<(), BenchError> {
    let drawn: Vec<&StabilitySweep> = report
        .sweeps
        .iter()
        .filter(|sweep| !sweep.points.is_empty())
        .collect();
    let drawings = drawn.iter().map(|sweep| drawing_file(sweep));
    let files: Vec<String> = [STABILITY_FILE, STABILITY_TABLE, STABILITY_PAGE]
        .map(str::to_owned)
        .into_iter()
        .chain(drawings)
        .collect();
    StagePlan::new(out, "stability").run(files, progress, |made| {
        made.write_record(STABILITY_FILE, report)?;
        let rows = rows::csv(&rows::rows(report)).map_err(|error| {
            BenchError::internal(&made.path(STABILITY_TABLE), error.to_string())
        })?;
        made.write_bytes(STABILITY_TABLE, &rows)?;
        made.write_bytes(STABILITY_PAGE, stability_page(report).as_bytes())?;
        for sweep in drawn {
            let file = drawing_file(sweep);
            let drawing = drawing(sweep)
                .map_err(|error| BenchError::internal(&made.path(&file), error.to_string()))?;
            made.write_bytes(&file, drawing.as_bytes())?;
        }
        Ok(())
    })
}

fn drawing_file(sweep: &StabilitySweep) -> String {
    format!("stability-{}.svg", sweep.id)
}

/// Returns cases and points of sweeps that miss their limits, in words.
pub fn stability_failures(report: &StabilityReport) -> Vec<String> {
    let rows = report.rows.iter();
    let rows = rows
        .filter(|row| row.status == StabilityStatus::Fail)
        .map(|row| format!("{} ({}, {})", row.case, row.parameterization, row.backend));
    let of_sweep = |sweep: &StabilitySweep| {
        let id = sweep.id.clone();
        let failed = sweep.points.iter().filter(|point| point.fault.is_some());
        let named = failed
            .map(move |point| format!("sweep {id} at {:.0e} ({})", point.condition, point.backend));
        named.collect::<Vec<_>>()
    };
    rows.chain(report.sweeps.iter().flat_map(of_sweep))
        .collect()
}

fn drawing(sweep: &StabilitySweep) -> Result<String, ChartError> {
    type Measure = fn(&StabilityMeasures) -> Option<f64>;
    let measures: [(&str, Measure); 2] = [
        ("image", |measured| measured.forward_error),
        ("gradient", |measured| measured.gradient_error),
    ];
    let mut backends: Vec<&str> = sweep.points.iter().map(|p| p.backend.as_str()).collect();
    backends.dedup();
    let mut series = Vec::new();
    for backend in backends {
        for (name, measure) in measures {
            let points = sweep
                .points
                .iter()
                .filter(|point| point.backend == backend)
                .filter_map(|point| {
                    let error = measure(&point.measured)?;
                    Some((point.condition, error.max(SMALLEST_ERROR)))
                })
                .collect();
            series.push(Series {
                name: format!("{name}, {backend}"),
                points,
            });
        }
    }
    let titles = Titles {
        x: &sweep.condition,
        y: "largest error against f64",
    };
    log_log(SIZE, &sweep.title, &titles, &series)
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::{StabilityPoint, StabilityRow};
    use omnilife_schemas::{progress::Silent, store};

    use super::*;

    fn report() -> StabilityReport {
        let measured = StabilityMeasures {
            forward_error: Some(1.5e-6),
            forward_share: Some(0.0),
            forward_limit: Some(1e-5),
            gradient_error: Some(2e-4),
            gradient_limit: Some(4e-4),
            is_finite: true,
            drawn: 3,
            gaussians: 4,
        };
        let row = |case: &str, backend: &str, status, reason: &str| StabilityRow {
            case: case.to_owned(),
            title: "in words".to_owned(),
            parameterization: "static".to_owned(),
            backend: backend.to_owned(),
            measured: (status != StabilityStatus::NotRun).then_some(measured),
            action: "drew 3 of 4".to_owned(),
            status,
            reason: reason.to_owned(),
        };
        StabilityReport {
            versions: [].into(),
            wall_seconds: 1.0,
            backends: [("cpu".to_owned(), "a processor".to_owned())].into(),
            parameterizations: vec!["static".to_owned()],
            rows: vec![
                row("poles", "cpu", StabilityStatus::Pass, "fine"),
                row("seam", "cpu", StabilityStatus::Fail, "the image is off"),
                row("poles", "gpu", StabilityStatus::NotRun, "no adapter"),
                row("seam", "gpu", StabilityStatus::NotRun, "no adapter"),
            ],
            sweeps: vec![StabilitySweep {
                id: "needle".to_owned(),
                title: "Needles".to_owned(),
                condition: "length over thickness".to_owned(),
                limits: "gradient within 4e-4".to_owned(),
                points: [1.0, 10.0, 1e3]
                    .map(|condition| StabilityPoint {
                        backend: "cpu".to_owned(),
                        condition,
                        measured,
                        fault: (condition > 100.0).then(|| "the gradient is off".to_owned()),
                    })
                    .into(),
            }],
        }
    }

    #[test]
    fn the_report_is_a_record_a_table_a_page_and_a_drawing()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let report = report();
        write_stability(&report, folder.path(), &Silent)?;
        let record: StabilityReport = store::read_record(&folder.path().join(STABILITY_FILE))?;
        assert_eq!(record, report);
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name));
        insta::assert_snapshot!(read(STABILITY_TABLE)? + "\n" + &read(STABILITY_PAGE)?);
        let drawing = read("stability-needle.svg")?;
        assert!(drawing.starts_with("<svg") && drawing.contains("length over thickness"));
        let failed = stability_failures(&report);
        assert_eq!(failed, ["seam (static, cpu)", "sweep needle at 1e3 (cpu)"]);
        Ok(())
    }
}
