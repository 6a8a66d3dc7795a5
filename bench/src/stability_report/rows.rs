//! Flat rows of the stability report: lines of `stability.csv`.

use omnilife_schemas::records::{
    StabilityMeasures, StabilityPoint, StabilityReport, StabilityRow, StabilityStatus,
    StabilitySweep,
};
use serde::Serialize;

/// A case or a point of a sweep on one backend; numbers have two digits.
#[derive(Debug, Serialize)]
pub(super) struct Row<'a> {
    /// The parameterization of a case, or [`SWEEP`].
    pub(super) part: &'a str,
    /// Id of the case or of the sweep.
    pub(super) case: &'a str,
    title: &'a str,
    pub(super) backend: &'a str,
    /// The condition number of a sweep's point.
    pub(super) condition: Option<String>,
    pub(super) image_error: Option<String>,
    pub(super) image_limit: Option<String>,
    pub(super) gradient_error: Option<String>,
    pub(super) gradient_limit: Option<String>,
    finite: Option<bool>,
    pub(super) action: &'a str,
    pub(super) status: StabilityStatus,
    /// Reason for a failure or for not running; empty where the row passes.
    pub(super) reason: &'a str,
    /// The larger of both errors relative to their limits, percent.
    #[serde(skip)]
    pub(super) share: Option<f64>,
}

/// The part of all points of sweeps.
const SWEEP: &str = "sweep";

/// Returns all rows: those of cases, then those of sweeps, in the report's order.
pub(super) fn rows(report: &StabilityReport) -> Vec<Row<'_>> {
    let points = report.sweeps.iter().flat_map(|sweep| {
        let points = sweep.points.iter();
        points.map(move |point| of_point(sweep, point))
    });
    report.rows.iter().map(of_case).chain(points).collect()
}

/// Returns rows as CSV.
///
/// # Errors
/// When a row cannot be encoded.
pub(super) fn csv(rows: &[Row<'_>]) -> Result<Vec<u8>, csv::Error> {
    let mut text = Vec::new();
    let mut table = csv::Writer::from_writer(&mut text);
    for row in rows {
        table.serialize(row)?;
    }
    table.flush()?;
    drop(table);
    Ok(text)
}

fn of_case(row: &StabilityRow) -> Row<'_> {
    let is_pass = row.status == StabilityStatus::Pass;
    Row {
        part: &row.parameterization,
        case: &row.case,
        title: &row.title,
        action: &row.action,
        status: row.status,
        reason: if is_pass { "" } else { &row.reason },
        ..measured(&row.backend, row.measured.as_ref())
    }
}

fn of_point<'a>(sweep: &'a StabilitySweep, point: &'a StabilityPoint) -> Row<'a> {
    let status = match point.fault {
        None => StabilityStatus::Pass,
        Some(_) => StabilityStatus::Fail,
    };
    Row {
        part: SWEEP,
        case: &sweep.id,
        title: &sweep.title,
        condition: Some(format!("{:e}", point.condition)),
        status,
        reason: point.fault.as_deref().unwrap_or_default(),
        ..measured(&point.backend, Some(&point.measured))
    }
}

fn measured<'a>(backend: &'a str, measures: Option<&StabilityMeasures>) -> Row<'a> {
    type Number = fn(&StabilityMeasures) -> Option<f64>;
    let number = |of: Number| Some(format!("{:.1e}", measures.and_then(of)?));
    let share = |error: Number, limit: Number| {
        let (error, limit) = (measures.and_then(error)?, measures.and_then(limit)?);
        Some(100.0 * error / limit)
    };
    let shares = [
        share(|m| m.forward_error, |m| m.forward_limit),
        share(|m| m.gradient_error, |m| m.gradient_limit),
    ];
    Row {
        part: "",
        case: "",
        title: "",
        backend,
        condition: None,
        image_error: number(|m| m.forward_error),
        image_limit: number(|m| m.forward_limit),
        gradient_error: number(|m| m.gradient_error),
        gradient_limit: number(|m| m.gradient_limit),
        finite: measures.map(|m| m.is_finite),
        action: "",
        status: StabilityStatus::NotRun,
        reason: "",
        share: shares.into_iter().flatten().reduce(f64::max),
    }
}
