//! The page for people: numbers of rows, the worst of them, and those without an error.

use std::fmt::Write;

use omnilife_schemas::records::{StabilityReport, StabilityStatus};

use super::rows::{Row, rows};

/// Rows that the page shows.
const SHOWN: usize = 20;

/// Returns the report as Markdown: numbers of rows by part, the rows nearest to their limits, failures, rows
/// without an error, and the backends.
pub fn stability_page(report: &StabilityReport) -> String {
    let rows = rows(report);
    let mut text = String::new();
    counts(&mut text, &rows);
    worst(&mut text, &rows);
    list(&mut text, "Failed", &rows, |row| {
        row.status == StabilityStatus::Fail
    });
    list(&mut text, "Without an error", &rows, |row| {
        row.share.is_none()
    });
    text += "\nBackends:\n\n";
    for (backend, description) in &report.backends {
        text += &format!("- {backend}: {description}\n");
    }
    text
}

fn counts(text: &mut String, rows: &[Row<'_>]) {
    *text += "| Part | Backend | Rows | Pass | Fail | Not run | Without an error | Largest share of a limit |\n\
              | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |\n";
    let mut parts: Vec<(&str, &str)> = Vec::new();
    for row in rows {
        if !parts.contains(&(row.part, row.backend)) {
            parts.push((row.part, row.backend));
        }
    }
    for (part, backend) in parts {
        let of_part: Vec<&Row<'_>> = rows
            .iter()
            .filter(|row| (row.part, row.backend) == (part, backend))
            .collect();
        let with = |status: StabilityStatus| {
            let found = of_part.iter().filter(|row| row.status == status);
            found.count().to_string()
        };
        let shares: Vec<f64> = of_part.iter().filter_map(|row| row.share).collect();
        let cells = [
            part.to_owned(),
            backend.to_owned(),
            of_part.len().to_string(),
            with(StabilityStatus::Pass),
            with(StabilityStatus::Fail),
            with(StabilityStatus::NotRun),
            (of_part.len() - shares.len()).to_string(),
            percent(shares.into_iter().reduce(f64::max)),
        ];
        line(text, &cells);
    }
}

/// Appends the rows with the largest shares of their limits; equal shares keep the order of the rows.
fn worst(text: &mut String, rows: &[Row<'_>]) {
    *text += "\n| Case | Part | Backend | Image | Gradient | Share of the limit | Action |\n\
              | --- | --- | --- | ---: | ---: | ---: | --- |\n";
    let mut order: Vec<&Row<'_>> = rows.iter().filter(|row| row.share.is_some()).collect();
    order.sort_by(|a, b| {
        let [a, b] = [a, b].map(|row| row.share.unwrap_or_default());
        b.total_cmp(&a)
    });
    for row in order.into_iter().take(SHOWN) {
        let cells = [
            name(row),
            row.part.to_owned(),
            row.backend.to_owned(),
            error(row.image_error.as_deref(), row.image_limit.as_deref()),
            error(row.gradient_error.as_deref(), row.gradient_limit.as_deref()),
            percent(row.share),
            row.action.to_owned(),
        ];
        line(text, &cells);
    }
}

/// Names rows by backend, status and reason, in order; rows of one case once.
fn list(text: &mut String, title: &str, rows: &[Row<'_>], is_listed: fn(&Row<'_>) -> bool) {
    let mut groups: Vec<(&Row<'_>, Vec<String>)> = Vec::new();
    for row in rows.iter().filter(|row| is_listed(row)) {
        let key = |row: &Row<'_>| (row.backend.to_owned(), row.status, row.reason.to_owned());
        let found = groups.iter_mut().find(|(first, _)| key(first) == key(row));
        match found {
            Some((_, names)) => names.push(name(row)),
            None => groups.push((row, vec![name(row)])),
        }
    }
    if groups.is_empty() {
        return;
    }
    *text += &format!("\n{title}:\n\n");
    for (first, mut names) in groups {
        let count = names.len();
        names.dedup();
        let status = match first.status {
            StabilityStatus::Pass => "pass",
            StabilityStatus::Fail => "fail",
            StabilityStatus::NotRun => "not run",
        };
        let reason = match first.reason {
            "" => String::new(),
            reason => format!(", {reason}"),
        };
        *text += &format!(
            "- {count} on {}, {status}{reason}: {}\n",
            first.backend,
            names.join(", ")
        );
    }
}

fn name(row: &Row<'_>) -> String {
    match &row.condition {
        None => format!("`{}`", row.case),
        Some(condition) => format!("`{}` at {condition}", row.case),
    }
}

fn error(error: Option<&str>, limit: Option<&str>) -> String {
    match (error, limit) {
        (None, _) => String::new(),
        (Some(error), None) => error.to_owned(),
        (Some(error), Some(limit)) => format!("{error} of {limit}"),
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or(String::new(), |share| format!("{share:.0} %"))
}

fn line(text: &mut String, cells: &[String]) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}
