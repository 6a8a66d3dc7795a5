//! Parts of the catalogue one by one, for the mutants that they have to notice (`scripts/mutants`).

use omnilife_schemas::records::{StabilityRow, StabilityStatus};

use crate::{
    cases, control,
    devices::{Device, DeviceKind},
    gradients, objects,
    parameterizations::STATIC,
    row,
    special::SpecialCase,
};

fn assert_pass(rows: impl Iterator<Item = StabilityRow>) {
    let failed: Vec<String> = rows
        .filter(|row| row.status == StabilityStatus::Fail)
        .map(|row| format!("{}: {}", row.case, row.reason))
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

fn assert_all_pass(cases: &[SpecialCase]) {
    assert_pass(cases.iter().map(|case| case.row(DeviceKind::Cpu)));
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

#[test]
fn rows_of_objects_keep_their_limits() {
    assert_all_pass(objects::CASES);
}
