//! Parts of the catalogue one by one, for the mutants that they have to notice (`scripts/mutants`).

use std::collections::BTreeSet;

use omnilife_schemas::records::{StabilityRow, StabilityStatus};

use crate::{
    cases, control,
    devices::{Device, DeviceKind},
    gradients, losses, networks, objects,
    parameterizations::STATIC,
    poses, row,
    special::{self, HostOnly, Runs, SpecialCase},
};

fn assert_pass(rows: impl Iterator<Item = StabilityRow>) {
    let failed: Vec<String> = rows
        .filter(|row| row.status == StabilityStatus::Fail)
        .map(|row| format!("{}: {} ({})", row.case, row.reason, row.action))
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

fn assert_all_pass(cases: &[SpecialCase]) {
    let device = Device::open(DeviceKind::Cpu).expect("a CPU");
    assert_pass(cases.iter().map(|case| case.row(&device)));
}

#[test]
fn rendered_rows_keep_their_limits() {
    let mut device = Device::open(DeviceKind::Cpu).expect("a CPU");
    let about_static = cases::all().filter(|case| case.about.contains(&STATIC.in_time));
    let rows = about_static.map(|case| row(case, &STATIC, &mut device).expect("a row"));
    assert_pass(rows);
}

#[test]
fn rows_of_gradients_keep_their_limits() {
    assert_all_pass(gradients::CASES);
}

#[test]
fn rows_of_control_keep_their_limits() {
    assert_all_pass(control::CASES);
}

/// Clips are judged by the whole catalogue alone, which takes minutes for them: it has those in which sizes ran away.
#[test]
fn the_catalogue_has_the_clips_without_texture() {
    let ids: Vec<&str> = special::all().map(|case| case.id).collect();
    for id in ["one-colour", "white-clip"] {
        assert!(ids.contains(&id), "{id}");
    }
}

#[test]
fn rows_of_objects_keep_their_limits() {
    assert_all_pass(objects::CASES);
}

/// Checks the rows of single parts on a GPU; clips, which train, and large images are judged by the whole catalogue
/// alone.
#[test]
fn rows_on_a_gpu_keep_their_limits() {
    let device = match Device::open(DeviceKind::Gpu) {
        Ok(device) => device,
        Err(reason) => return omnilife_schemas::testing::skip(reason),
    };
    let parts = [
        networks::CASES,
        objects::CASES,
        poses::CASES,
        gradients::CASES,
        control::CASES,
    ];
    let parts = parts.into_iter().flatten().chain(losses::all());
    assert_pass(parts.map(|case| {
        let row = case.row(&device);
        let is_left_out = row.status == StabilityStatus::NotRun;
        assert_eq!(is_left_out, case.runs != Runs::OnBoth, "{row:?}");
        row
    }));
}

#[test]
fn most_cases_run_on_both_devices_and_the_others_have_a_reason() {
    let on_both = special::all().filter(|case| case.runs == Runs::OnBoth);
    assert!(on_both.count() >= 45);
    let reasons = [
        HostOnly::Preparation,
        HostOnly::HostWork,
        HostOnly::Bytes,
        HostOnly::WithinSteps,
        HostOnly::Duration,
    ];
    for reason in reasons {
        let mut cases = special::all();
        assert!(
            cases.any(|case| case.runs == Runs::OnCpu(reason)),
            "{reason:?}"
        );
    }
    let words = reasons.map(HostOnly::in_words);
    assert_eq!(BTreeSet::from(words).len(), reasons.len());
}
