//! Curves of error against run time, from run folders to tables.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::curve::{self, CURVES_FILE, Clock, POINTS_FILE};
use omnilife_schemas::{
    Blame, Blamed, Similarity,
    records::{Backend, RunRecord, ViewPredictions},
    store,
};

fn write_run(folder: &Path, method: &str, scene: &str, trace: Option<&str>) -> PathBuf {
    fs::create_dir_all(folder).unwrap();
    let record = RunRecord {
        method: method.to_owned(),
        scene: scene.to_owned(),
        protocol_hash: "0123456789abcdef".to_owned(),
        seed: 3,
        hardware: None,
        backend: Backend::Cpu { threads: 2 },
        configuration: serde_json::json!({}),
        plan: Vec::new(),
        evidence: None,
        versions: [].into(),
        inputs: [].into(),
        iterations: 900,
        gaussians: 4000,
        training_seconds: 90.0,
        training_cpu_seconds: None,
        planning_seconds: 0.0,
        planning_cpu_seconds: None,
        evaluation_seconds: 7.5,
        rendering_seconds: 1.0,
        seconds_per_group: None,
        peak_memory_bytes: Some(3 << 29),
        normalization: Similarity {
            offset: [0.0; 3],
            scale: 1.0,
        },
        trace: trace.map(|_| "trace.csv".to_owned()),
        predictions: ViewPredictions {
            input_views: None,
            novel_views: "novel".to_owned(),
        },
        warnings: Vec::new(),
    };
    store::write_record(&folder.join("run.json"), &record).unwrap();
    if let Some(trace) = trace {
        fs::write(folder.join("trace.csv"), trace).unwrap();
    }
    folder.to_owned()
}

const TRACE: &str = "wall_seconds,evaluation_seconds,cpu_seconds,iteration,gaussians,novel_psnr_db,novel_ssim,refused_positions\n\
                     9,1,9,100,1000,19.5,0.5,0\n\
                     30,2,,300,2000,,,0\n\
                     45,5,45,450,3000,24.25,0.7,0\n\
                     90,7.5,90,900,4000,24.5,0.75,0\n";

#[test]
fn runs_become_tables_and_drawings() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let slow = TRACE.replace("24.5", "24").replace("\n90", "\n95");
    let runs = [
        write_run(&at("a"), "odgs", "street", Some(TRACE)),
        write_run(&at("b"), "pvg", "street", Some(&slow)).join("run.json"),
        write_run(&at("c"), "odgs", "hall", Some(TRACE)),
    ];
    let comparisons = curve::curves(&runs, Clock::Wall, &at("out")).unwrap();
    assert_eq!(comparisons.len(), 2);
    insta::assert_snapshot!("table", curve::curves_table(&comparisons));
    insta::assert_snapshot!(
        "csv",
        fs::read_to_string(at("out").join(CURVES_FILE)).unwrap()
    );
    let points = fs::read_to_string(at("out").join(POINTS_FILE)).unwrap();
    // Three scored rows of each run and a heading.
    assert_eq!(points.lines().count(), 10);
    for number in 0..2 {
        let drawing = fs::read_to_string(at("out").join(format!("curve-{number}.svg"))).unwrap();
        assert!(drawing.contains("training time, s"));
    }
}

#[test]
fn processor_time_is_a_clock_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = write_run(
        &at("a"),
        "odgs",
        "street",
        Some(&TRACE.replace("90,900", "180,900")),
    );
    let comparisons = curve::curves(&[run], Clock::Cpu, &at("out")).unwrap();
    let measured = &comparisons[0].curves[0];
    assert_eq!(measured.run.training_seconds, 180.0);
    let drawing = fs::read_to_string(at("out/curve-0.svg")).unwrap();
    assert!(drawing.contains("processor seconds"));
    assert!(curve::curves_table(&comparisons).contains(", processor seconds\n"));

    let unknown = TRACE.replace(",9,100,", ",,100,");
    let run = write_run(&at("b"), "odgs", "street", Some(&unknown));
    let error = curve::curves(&[run], Clock::Cpu, &at("out")).unwrap_err();
    assert_eq!(error.blame(), Blame::Input);
    assert!(
        error
            .to_string()
            .contains("does not know the processor time"),
        "{error}"
    );
}

#[test]
fn runs_without_a_usable_trace_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        (None, "leaves no trace"),
        (Some("wall_seconds,iteration\n1,2\n"), "trace.csv: "),
        (
            Some("wall_seconds,iteration,novel_psnr_db\n1,2,\n"),
            "scores no novel views",
        ),
        (
            Some("wall_seconds,iteration,novel_psnr_db\n2,2,20\n1,3,21\n"),
            "goes back in time",
        ),
    ];
    for (number, (trace, expected)) in cases.into_iter().enumerate() {
        let run = write_run(&folder.path().join(number.to_string()), "m", "s", trace);
        let error = curve::curves(&[run], Clock::Wall, &folder.path().join("out")).unwrap_err();
        assert_eq!(error.blame(), Blame::Input);
        assert!(error.to_string().contains(expected), "{error}");
    }
}
