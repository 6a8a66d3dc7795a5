//! Runs without a trace beside runs with one.

use std::fs;

use omnilife_bench::curve::{self, Clock, Crossing, POINTS_FILE, Region};
use omnilife_schemas::{
    Classified, ErrorKind,
    elapsed::Elapsed,
    progress::Silent,
    records::{Direction, Failure, ResultRecord, StageTime, Summary, TrainingKind},
};

use super::{CURVE, csv_of, record, write_record, write_scores};

/// A result whose novel views have this PSNR.
fn scored(method: &str, psnr_db: f64) -> ResultRecord {
    let summary = |mean: f64, direction| Summary {
        mean,
        standard_deviation: None,
        views: 2,
        undefined_views: 0,
        direction: Some(direction),
    };
    ResultRecord {
        novel_views: [
            (
                "psnr".to_owned(),
                summary(psnr_db, Direction::HigherIsBetter),
            ),
            (
                "lpips-alex".to_owned(),
                summary(0.25, Direction::LowerIsBetter),
            ),
        ]
        .into(),
        ..record(method, "street")
    }
}

#[test]
fn runs_without_a_trace_are_points() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let external = ResultRecord {
        training_seconds: Some(60.0),
        iterations: None,
        primitives: None,
        backend: None,
        training: Some(TrainingKind::PerScene),
        ..scored("others", 26.5)
    };
    let untrained = ResultRecord {
        training_seconds: None,
        iterations: None,
        training: Some(TrainingKind::WithoutTraining),
        ..scored("nearest-input", 21.0)
    };
    let unknown = ResultRecord {
        training_seconds: None,
        ..scored("handed-in", 23.0)
    };
    let runs = [
        write_scores(&at("a"), "odgs", "street", Some(CURVE)),
        write_record(&at("b"), &external, None),
        write_record(&at("c"), &untrained, None),
        write_record(&at("d"), &unknown, None),
    ];
    let found = curve::curves(&runs, Clock::Wall, Region::Whole, &at("out"), &Silent).unwrap();
    let curves = &found[0].curves;
    let seconds: Vec<_> = (curves.iter())
        .map(|curve| curve.run.training_seconds)
        .collect();
    assert_eq!(seconds, [Some(90.0), Some(60.0), Some(0.0), None]);
    let front: Vec<_> = curves.iter().map(|curve| curve.on_front).collect();
    assert_eq!(front, [false, true, true, false]);
    assert_eq!(curves[1].to_quality[3], Crossing::AtMost { seconds: 60.0 });
    assert_eq!(curves[2].to_quality[0].seconds(), Some(0.0));
    // One curve alone has no area, and a line says how each of the others is shown.
    assert_eq!(found[0].span, None);
    let of_others = [
        "no area: fewer than two runs have scores along their training",
        "others, seed 3: no scores along its training; its end is a point",
        "nearest-input, seed 3: no training; its score is drawn as a level",
        "handed-in, seed 3: no record has the training time; its score is drawn as a level",
    ];
    assert_eq!(found[0].notes, of_others);
    assert!(curves.iter().all(|curve| curve.log_area_db.is_none()));
    let table = curve::curves_table(&found);
    assert!(
        table.contains("| <60.0 |") && table.contains("| 0.2500 |"),
        "{table}"
    );
    assert!(found[0].notes.iter().all(|note| table.contains(note)));
    let (_, points) = csv_of(&at("out").join(POINTS_FILE));
    let points: Vec<_> = (points.iter())
        .map(|row| [2, 6, 8, 10].map(|column| row[column].as_str()))
        .collect();
    // Three rows of the curve, then an end of each of the others.
    assert_eq!(
        points[2..5],
        [
            ["odgs", "90.0", "900", "24.5"],
            ["others", "60.0", "", "26.5"],
            ["nearest-input", "0.0", "", "21.0"],
        ]
    );
    assert_eq!(points[5][..2], ["handed-in", ""]);
    let drawing = fs::read_to_string(at("out/curve-0.svg")).unwrap();
    for name in [
        "others, seed 3",
        "nearest-input, seed 3, without training",
        "time not known",
    ] {
        assert!(drawing.contains(name), "{name}");
    }
}

#[test]
fn a_curve_without_scores_or_times_is_a_point() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let head = "wall_seconds,evaluation_seconds,cpu_seconds,iteration,primitives,novel_psnr_db\n";
    let unscored = format!("{head}1,0,1,0,5,\n60,2,50,900,5,\n");
    let without_cpu_time = format!("{head}1,0,,0,5,15\n60,2,,900,5,25\n");
    let runs = [
        write_scores(&at("a"), "odgs", "street", Some(CURVE)),
        write_record(&at("b"), &scored("unscored", 25.0), Some(&unscored)),
        write_record(&at("c"), &scored("timeless", 24.0), Some(&without_cpu_time)),
    ];
    let rows = |clock: Clock| {
        let out = at("out").join(clock.name());
        let found = curve::curves(&runs, clock, Region::Whole, &out, &Silent).unwrap();
        let curves = found[0].curves.iter();
        let rows: Vec<_> = curves.map(|curve| curve.run.rows.len()).collect();
        (rows, found[0].notes.join("\n"))
    };
    let (of_wall, notes) = rows(Clock::Wall);
    assert_eq!(of_wall, [3, 0, 2]);
    assert!(
        notes.contains("unscored, seed 3: no scores along"),
        "{notes}"
    );
    let (of_cpu, notes) = rows(Clock::Cpu);
    assert_eq!(of_cpu, [3, 0, 0]);
    assert!(
        notes.contains("timeless, seed 3: no record has the CPU time"),
        "{notes}"
    );
}

#[test]
fn runs_without_any_time_are_drawn_too() {
    let folder = tempfile::tempdir().unwrap();
    let run = ResultRecord {
        training_seconds: Some(0.0),
        ..scored("nearest-input", 21.0)
    };
    let run = write_record(&folder.path().join("a"), &run, None);
    for clock in [Clock::Wall, Clock::Cpu] {
        let out = folder.path().join(clock.name());
        let found = curve::curves(
            std::slice::from_ref(&run),
            clock,
            Region::Whole,
            &out,
            &Silent,
        )
        .unwrap();
        assert_eq!(found[0].curves[0].run.training_seconds, Some(0.0));
        assert!(out.join("curve-0.svg").is_file());
    }
}

#[test]
fn a_point_has_the_cpu_time_of_planning_and_training() {
    let folder = tempfile::tempdir().unwrap();
    let stage = |stage: &str, cpu_seconds: f64| StageTime {
        stage: stage.to_owned(),
        method: None,
        took: Elapsed {
            wall_seconds: 1.0,
            cpu_seconds: Some(cpu_seconds),
        },
    };
    let traceless = ResultRecord {
        stages: vec![
            stage("poses", 500.0),
            stage("planning", 2.5),
            stage("training", 40.0),
            stage("rendering", 7.0),
        ],
        ..scored("odgs", 25.0)
    };
    let run = write_record(&folder.path().join("a"), &traceless, None);
    let read = |clock| curve::read_run(&run, clock, Region::Whole).unwrap();
    assert_eq!(read(Clock::Cpu).training_seconds, Some(42.5));
    assert_eq!(read(Clock::Wall).training_seconds, Some(90.0));
    assert_eq!(read(Clock::Wall).final_scores.lpips_alex, Some(0.25));
}

#[test]
fn a_result_that_is_not_complete_is_no_point() {
    let folder = tempfile::tempdir().unwrap();
    let failed = ResultRecord {
        failures: vec![Failure {
            view: "novel".to_owned(),
            frame: 3,
            reason: "is black".to_owned(),
        }],
        ..scored("odgs", 25.0)
    };
    let run = write_record(&folder.path().join("a"), &failed, None);
    let error = curve::read_run(&run, Clock::Wall, Region::Whole).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().contains("is black"), "{error}");
    // Nor is one without the requested score.
    let run = write_record(&folder.path().join("b"), &scored("odgs", 25.0), None);
    let error = curve::read_run(&run, Clock::Wall, Region::Dynamic).unwrap_err();
    assert!(error.to_string().contains("psnr-dynamic"), "{error}");
}
