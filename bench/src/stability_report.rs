//! The stability report for people: a table, and the errors of stiff cases over their condition
//! number.
//!
//! This crate only reports; the cases are run where the kernels are.

use std::{fmt::Write, path::Path};

use omnilife_schemas::{
    progress::Progress,
    records::{StabilityMeasures, StabilityReport, StabilityRow, StabilityStatus, StabilitySweep},
    stage::StagePlan,
};

use crate::{
    chart::{self, Series, Titles},
    error::BenchError,
};

/// The whole report.
pub const STABILITY_FILE: &str = "stability.json";
/// The table for people.
pub const STABILITY_TABLE: &str = "stability.md";

/// Errors below this are drawn here: 0 has no place on a logarithmic axis.
const SMALLEST_ERROR: f64 = 1e-9;

/// Writes `stability.json`, `stability.md` and `stability-<sweep>.svg` into a folder, which is made
/// where it is missing.
///
/// # Errors
/// When a file that is not ours is in the way, or one cannot be written.
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
    let files: Vec<String> = [STABILITY_FILE, STABILITY_TABLE]
        .map(str::to_owned)
        .into_iter()
        .chain(drawings)
        .collect();
    StagePlan::new(out, "stability").run(files, progress, |made| {
        made.write_record(STABILITY_FILE, report)?;
        made.write_bytes(STABILITY_TABLE, stability_table(report).as_bytes())?;
        for sweep in drawn {
            let file = drawing_file(sweep);
            let drawing =
                drawing(sweep).map_err(|reason| BenchError::internal(&made.path(&file), reason))?;
            made.write_bytes(&file, drawing.as_bytes())?;
        }
        Ok(())
    })
}

fn drawing_file(sweep: &StabilitySweep) -> String {
    format!("stability-{}.svg", sweep.id)
}

/// Cases and points of sweeps that are not as good as asked, in words.
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

/// The report as Markdown.
pub fn stability_table(report: &StabilityReport) -> String {
    let mut text = String::from(
        "| Case | Gaussians | Backend | Image | Gradient | Finite | What the code does | Status |\n\
         | --- | --- | --- | ---: | ---: | --- | --- | --- |\n",
    );
    let (ran, missing): (Vec<_>, Vec<_>) = report
        .rows
        .iter()
        .partition(|row| row.status != StabilityStatus::NotRun);
    for row in ran {
        let measured = row.measured.as_ref();
        let status = match row.status {
            StabilityStatus::Fail => format!("**fail**: {}", row.reason),
            _ => "pass".to_owned(),
        };
        let cells = [
            format!("`{}`: {}", row.case, row.title),
            row.parameterization.clone(),
            row.backend.clone(),
            error(measured.and_then(|m| m.forward_error)),
            error(measured.and_then(|m| m.gradient_error)),
            measured
                .map_or("", |m| if m.is_finite { "yes" } else { "no" })
                .to_owned(),
            row.action.clone(),
            status,
        ];
        line(&mut text, &cells);
    }
    for sweep in &report.sweeps {
        sweep_table(&mut text, sweep);
    }
    if !missing.is_empty() {
        text += "\nNot run:\n\n";
        for (backend, reason, cases) in by_reason(&missing) {
            text += &format!("- {backend}: {} ({reason})\n", cases.join(", "));
        }
    }
    text += "\nBackends:\n\n";
    for (backend, description) in &report.backends {
        text += &format!("- {backend}: {description}\n");
    }
    text
}

fn sweep_table(text: &mut String, sweep: &StabilitySweep) {
    let mut backends: Vec<&str> = sweep.points.iter().map(|p| p.backend.as_str()).collect();
    backends.dedup();
    if backends.is_empty() {
        return;
    }
    *text += &format!("\n{}, {}", sweep.title, sweep.condition);
    if !sweep.limits.is_empty() {
        *text += &format!("; {}", sweep.limits);
    }
    *text += ":\n\n| Condition |";
    for backend in &backends {
        *text += &format!(" Image, {backend} | Gradient, {backend} |");
    }
    *text += "\n| ---: |";
    *text += &" ---: | ---: |".repeat(backends.len());
    *text += "\n";
    let of_first = sweep.points.iter().filter(|p| p.backend == backends[0]);
    for condition in of_first.map(|point| point.condition) {
        let mut cells = vec![format!("{condition:.0e}")];
        for backend in &backends {
            let point = sweep
                .points
                .iter()
                .find(|p| p.backend == *backend && p.condition == condition);
            cells.push(error(point.and_then(|p| p.measured.forward_error)));
            let gradient = error(point.and_then(|p| p.measured.gradient_error));
            let fault = point.and_then(|point| point.fault.as_ref());
            cells.push(fault.map_or(gradient.clone(), |why| {
                format!("{gradient} **fail**: {why}")
            }));
        }
        line(text, &cells);
    }
}

fn line(text: &mut String, cells: &[String]) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn error(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value:.1e}"))
}

/// Cases that did not run, by backend and reason, in order.
fn by_reason<'a>(rows: &[&'a StabilityRow]) -> Vec<(&'a str, &'a str, Vec<&'a str>)> {
    let mut groups: Vec<(&str, &str, Vec<&str>)> = Vec::new();
    for row in rows {
        let found = groups
            .iter_mut()
            .find(|(backend, reason, _)| *backend == row.backend && *reason == row.reason);
        match found {
            Some((_, _, cases)) => cases.push(&row.case),
            None => groups.push((&row.backend, &row.reason, vec![&row.case])),
        }
    }
    groups
}

fn drawing(sweep: &StabilitySweep) -> Result<String, String> {
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
        chart: &sweep.title,
        x: &sweep.condition,
        y: "largest error against f64",
    };
    chart::log_log(&titles, &series)
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{progress::Silent, store};

    use super::*;

    fn report() -> StabilityReport {
        let measured = StabilityMeasures {
            forward_error: Some(1.5e-6),
            forward_share: Some(0.0),
            gradient_error: Some(2e-4),
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
                    .map(|condition| omnilife_schemas::records::StabilityPoint {
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
    fn the_report_is_a_table_a_record_and_a_drawing() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let report = report();
        write_stability(&report, folder.path(), &Silent)?;
        let record: StabilityReport = store::read_record(&folder.path().join(STABILITY_FILE))?;
        assert_eq!(record, report);
        insta::assert_snapshot!(std::fs::read_to_string(
            folder.path().join(STABILITY_TABLE)
        )?);
        let drawing = std::fs::read_to_string(folder.path().join("stability-needle.svg"))?;
        assert!(drawing.starts_with("<svg") && drawing.contains("length over thickness"));
        let failed = stability_failures(&report);
        assert_eq!(failed, ["seam (static, cpu)", "sweep needle at 1e3 (cpu)"]);
        Ok(())
    }
}
