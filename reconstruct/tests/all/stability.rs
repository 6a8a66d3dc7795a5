//! The stability catalogue on every backend: every case keeps its limits.

use omnilife_schemas::{progress::Silent, records::StabilityStatus};
use omnilife_stability::devices::{Device, DeviceKind};

#[test]
fn every_case_passes_on_the_cpu() {
    every_case_passes(DeviceKind::Cpu);
}

#[test]
fn every_case_passes_on_a_gpu() {
    match Device::open(DeviceKind::Gpu) {
        Ok(device) => println!("on {}", device.describe()),
        Err(reason) => return omnilife_schemas::testing::skip(reason),
    }
    every_case_passes(DeviceKind::Gpu);
}

fn every_case_passes(kind: DeviceKind) {
    let report = omnilife_stability::run(&[kind], &Silent).unwrap();
    for row in &report.rows {
        let measured = row.measured;
        println!(
            "{:20} {:10} image {:?} share {:?} gradient {:?} {} {:?} {}",
            row.case,
            row.parameterization,
            measured.and_then(|m| m.forward_error),
            measured.and_then(|m| m.forward_share),
            measured.and_then(|m| m.gradient_error),
            row.action,
            row.status,
            row.reason
        );
    }
    for sweep in &report.sweeps {
        for point in &sweep.points {
            println!(
                "{:10} {:8.0e} image {:?} gradient {:?}",
                sweep.id,
                point.condition,
                point.measured.forward_error,
                point.measured.gradient_error
            );
        }
        assert!(!sweep.points.is_empty(), "{}", sweep.id);
        let faults = sweep.points.iter().filter_map(|point| point.fault.as_ref());
        assert_eq!(
            faults.collect::<Vec<_>>(),
            Vec::<&String>::new(),
            "{}",
            sweep.id
        );
    }
    println!("{:.1} s", report.wall_seconds);
    let failed: Vec<&str> = report
        .rows
        .iter()
        .filter(|row| row.status == StabilityStatus::Fail)
        .map(|row| row.case.as_str())
        .collect();
    assert!(failed.is_empty(), "{failed:?}");
}
