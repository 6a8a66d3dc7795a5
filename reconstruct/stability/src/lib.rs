//! Stiff and extreme cases on every backend and parameterization, judged by the f64 reference.
//!
//! * [`setup`]: setups of cases;
//! * [`cases`]: the catalogue. `case_setups`: its setups, `in_time`: cases of time, `channels`: harmonics and
//!   features;
//! * [`special`]: cases without rendering. `losses`: the photometric loss of awkward images, `networks`:
//!   networks, `clips`: clips for training, `depth`: lift and fusion, `atlas`: parts of atlases, `objects`:
//!   motion along paths, `gradients`: gradients against differences, `control`: density control, seeds, gains
//!   and pose steps, `large`: an image of 4096 columns;
//! * [`sweeps`]: families of cases whose condition number grows;
//! * [`parameterizations`], [`devices`]: parameterizations and devices under test;
//! * [`mod@measure`]: errors of image and gradient against [`omnilife_engine::render::reference`].
//!
//! A new case needs a function and a line in its slice.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod atlas;
mod case_setups;
pub mod cases;
pub mod channels;
mod clips;
mod control;
mod depth;
pub mod devices;
mod gradients;
mod in_time;
mod large;
mod losses;
pub mod measure;
mod networks;
mod objects;
pub mod parameterizations;
mod poses;
pub mod setup;
pub mod special;
pub mod sweeps;
#[cfg(test)]
mod tests;

use std::{collections::BTreeMap, time::Instant};

pub(crate) use omnilife_schemas::statistics::largest_or_nan;
use omnilife_schemas::{
    progress::Progress,
    provenance,
    records::{StabilityMeasures, StabilityReport, StabilityRow, StabilityStatus},
};

use cases::{Case, Expectation};
use devices::{Device, DeviceKind};
use measure::{MeasuredCase, measure};
use omnilife_training::error::ReconstructError;
use parameterizations::{PARAMETERIZATIONS, Parameterization};
use sweeps::SWEEPS;

/// Name in cases without a parameterization.
const NO_PARAMETERIZATION: &str = "none";
/// Maximum difference of a colour value where a Gaussian's edge, or the end of compositing, is on different sides
/// in f32 and in f64: two steps of 1/255.
const LARGEST_SWITCH: f64 = 8e-3;
/// Maximum share of the values with such a difference.
const SWITCH_SHARE: f64 = 0.01;

/// Runs the whole catalogue on these devices.
///
/// # Errors
/// When a device fails in the middle of its work.
pub fn run(
    kinds: &[DeviceKind],
    progress: &dyn Progress,
) -> Result<StabilityReport, ReconstructError> {
    let begun = Instant::now();
    let mut report = StabilityReport {
        versions: provenance::versions(),
        wall_seconds: 0.0,
        backends: BTreeMap::new(),
        parameterizations: PARAMETERIZATIONS.iter().map(|p| p.id.to_owned()).collect(),
        rows: Vec::new(),
        sweeps: SWEEPS.iter().map(sweeps::Sweep::record).collect(),
    };
    progress.begin(
        "stability",
        Some((kinds.len() * steps_of_a_device()) as u64),
    );
    let outcome = kinds
        .iter()
        .try_for_each(|&kind| on_device(kind, &mut report, progress));
    progress.end();
    outcome?;
    report.wall_seconds = begun.elapsed().as_secs_f64();
    Ok(report)
}

fn steps_of_a_device() -> usize {
    cases::all().count() + channels::CASES.len() + special::all().count() + SWEEPS.len()
}

fn on_device(
    kind: DeviceKind,
    report: &mut StabilityReport,
    progress: &dyn Progress,
) -> Result<(), ReconstructError> {
    let mut device = match Device::open(kind) {
        Ok(device) => device,
        Err(reason) => {
            report.backends.insert(kind.id().to_owned(), reason.clone());
            let rows = cases::all().map(|case| not_run(case, kind, &reason));
            report.rows.extend(rows);
            progress.advance(steps_of_a_device() as u64);
            return Ok(());
        }
    };
    report
        .backends
        .insert(kind.id().to_owned(), device.describe());
    for case in cases::all() {
        for parameterization in PARAMETERIZATIONS {
            if case.about.contains(&parameterization.in_time) {
                report.rows.push(row(case, parameterization, &mut device)?);
            }
        }
        progress.advance(1);
    }
    for case in channels::CASES {
        report.rows.push(case.row(&device)?);
        progress.advance(1);
    }
    for case in special::all() {
        report.rows.push(case.row(&device));
        progress.advance(1);
    }
    for (sweep, record) in SWEEPS.iter().zip(&mut report.sweeps) {
        record.points.extend(sweep.points(&mut device)?);
        progress.advance(1);
    }
    Ok(())
}

fn not_run(case: &Case, kind: DeviceKind, reason: &str) -> StabilityRow {
    StabilityRow {
        case: case.id.to_owned(),
        title: case.title.to_owned(),
        parameterization: NO_PARAMETERIZATION.to_owned(),
        backend: kind.id().to_owned(),
        measured: None,
        action: String::new(),
        status: StabilityStatus::NotRun,
        reason: reason.to_owned(),
    }
}

fn row(
    case: &Case,
    parameterization: &Parameterization,
    device: &mut Device,
) -> Result<StabilityRow, ReconstructError> {
    let setup = (case.setup)();
    let limits = case.limits;
    let degenerate = match case.expectation {
        Expectation::LeavesOut { degenerate } => degenerate,
        Expectation::Agrees | Expectation::ImageAgrees => 0,
    };
    let mut measured = measure(&setup, parameterization, device, degenerate, limits)?;
    if case.expectation == Expectation::ImageAgrees {
        measured.measures.gradient_limit = None;
    }
    let harm = if degenerate > 0 {
        damage_of(&setup, degenerate, parameterization, device, &measured)?
    } else {
        None
    };
    let fault = harm.or_else(|| fault(case.expectation, &measured.measures, &limits));
    let measures = measured.measures;
    let mut action = format!("drew {} of {}", measures.drawn, measures.gaussians);
    if !case.action.is_empty() {
        action += &format!("; {}", case.action);
    }
    Ok(StabilityRow {
        case: case.id.to_owned(),
        title: case.title.to_owned(),
        parameterization: parameterization.id.to_owned(),
        backend: device.kind().id().to_owned(),
        measured: Some(measures),
        action,
        status: if fault.is_none() {
            StabilityStatus::Pass
        } else {
            StabilityStatus::Fail
        },
        reason: fault.unwrap_or_else(|| case.expectation.in_words(&limits)),
    })
}

/// Limits of a case's errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Difference of a colour value.
    pub forward: f64,
    /// Relative difference of a gradient value.
    pub gradient: f64,
}

/// Returns the reason for unexpected measures, or `None`.
fn fault(
    expectation: Expectation,
    measures: &StabilityMeasures,
    limits: &Limits,
) -> Option<String> {
    if !measures.is_finite {
        return Some("some values are not finite".to_owned());
    }
    let forward = measures.forward_error.unwrap_or(f64::INFINITY);
    let share = measures.forward_share.unwrap_or(1.0);
    if forward > LARGEST_SWITCH.max(limits.forward) || share > SWITCH_SHARE {
        return Some(format!(
            "the image is off by up to {forward:.1e}, {:.2} % of it by more than {:.0e}",
            100.0 * share,
            limits.forward
        ));
    }
    let gradient = measures.gradient_error.unwrap_or(f64::INFINITY);
    (expectation != Expectation::ImageAgrees && gradient > limits.gradient).then(|| {
        format!(
            "the gradient is off by {gradient:.1e}, the limit is {:.0e}",
            limits.gradient
        )
    })
}

/// Returns the changes by the degenerate Gaussians at the end of a setup, or `None` without a change.
fn damage_of(
    setup: &setup::Setup,
    degenerate: usize,
    parameterization: &Parameterization,
    device: &mut Device,
    with: &MeasuredCase,
) -> Result<Option<String>, ReconstructError> {
    let mut clean = setup.clone();
    clean.gaussians.truncate(setup.gaussians.len() - degenerate);
    let table = (parameterization.table)(&clean);
    let without = device.round_trip(&clean, parameterization, table)?;
    Ok(
        (with.colour != without.colour)
            .then(|| "what cannot be drawn changes the image".to_owned()),
    )
}
