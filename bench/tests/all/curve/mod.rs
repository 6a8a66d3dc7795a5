//! Curves of error against run time, from folders of scores to tables.

mod points;

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::curve::{self, CURVES_FILE, Clock, POINTS_FILE, Region};
use omnilife_schemas::{
    Classified, ErrorKind,
    elapsed::Elapsed,
    layout::CURVE_FILE,
    progress::Silent,
    records::{Backend, ResultRecord, StageTime},
    store,
};

fn write_scores(folder: &Path, method: &str, scene: &str, curve: Option<&str>) -> PathBuf {
    write_record(folder, &record(method, scene), curve)
}

fn record(method: &str, scene: &str) -> ResultRecord {
    ResultRecord {
        protocol: "per-scene/2".to_owned(),
        protocol_hash: "0123456789abcdef".to_owned(),
        scored_size: [64, 32],
        training_seconds: Some(90.0),
        primitives: Some(4000),
        iterations: Some(900),
        seed: Some(3),
        backend: Some(Backend::Cpu { threads: 2 }),
        rendering_seconds: Some(1.0),
        peak_memory_bytes: Some(3 << 29),
        ..ResultRecord::new(method, scene)
    }
}

fn write_record(folder: &Path, record: &ResultRecord, curve: Option<&str>) -> PathBuf {
    fs::create_dir_all(folder).unwrap();
    store::write_record(&folder.join("result.json"), record).unwrap();
    if let Some(curve) = curve {
        fs::write(folder.join(CURVE_FILE), curve).unwrap();
    }
    folder.to_owned()
}

const CURVE: &str = "wall_seconds,evaluation_seconds,cpu_seconds,iteration,primitives,novel_views,novel_psnr_db,novel_ssim\n\
                     9,1,9,100,1000,2,19.5,0.5\n\
                     30,2,,300,2000,0,,\n\
                     45,5,45,450,3000,2,24.25,0.7\n\
                     90,7.5,90,900,4000,2,24.5,0.75\n";

#[test]
fn ghosts_and_holes_stand_in_the_table_where_a_run_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let rows = CURVE.lines().zip([
        ",ghost_share,input_hole_share,novel_hole_share",
        ",,,",
        ",,,",
        ",0.5,0.5,0.5",
        ",0.0125,0.03,",
    ]);
    let measured: String = rows.map(|(row, more)| format!("{row}{more}\n")).collect();
    let runs = [
        write_scores(&at("a"), "panogs", "hall", Some(&measured)),
        write_scores(&at("b"), "odgs", "hall", Some(CURVE)),
    ];
    let table = curve::curves_table(
        &curve::curves(&runs, Clock::Wall, Region::Whole, &at("out"), &Silent).unwrap(),
    );
    let ends = |line: &str| {
        table
            .lines()
            .any(|found| found.starts_with(line) && found.ends_with("| 1.25 | 3.00 | - |"))
    };
    assert!(ends("| panogs, seed 3"), "{table}");
    assert!(!ends("| odgs, seed 3"), "{table}");
    assert!(table.contains("| Ghosts % | Holes %, input | Holes %, novel |"));
    let points = fs::read_to_string(at("out").join(POINTS_FILE)).unwrap();
    assert!(points.contains(",0.0125,0.03,\n"), "{points}");
}

const CURVES_HEADER: &str = "scene,protocol_hash,method,seed,clock,region,preparation_seconds,training_seconds,\
    evaluation_seconds,iterations,primitives,peak_memory_bytes,final_psnr_db,final_ssim,final_lpips_alex,\
    on_pareto_front,first_seconds,first_psnr_db,log_area_from_seconds,log_area_until_seconds,log_area_db,\
    log_area_ssim,log_area_lpips_alex,seconds_to_1_db_below_end,iterations_to_1_db_below_end,\
    seconds_to_0.5_db_below_end,iterations_to_0.5_db_below_end,seconds_to_20_db,iterations_to_20_db,seconds_to_22_db,\
    iterations_to_22_db,seconds_to_24_db,iterations_to_24_db,seconds_to_26_db,iterations_to_26_db,seconds_to_28_db,\
    iterations_to_28_db,seconds_to_30_db,iterations_to_30_db,psnr_db_at_10_s,psnr_db_at_60_s,psnr_db_at_180_s,\
    psnr_db_at_600_s,psnr_db_at_1800_s,ghost_share,input_hole_share,novel_hole_share";

/// First line and the cells of the others.
fn csv_of(file: &Path) -> (String, Vec<Vec<String>>) {
    let text = fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let cells = |line: &str| line.split(',').map(str::to_owned).collect();
    (header, lines.map(cells).collect())
}

#[test]
fn runs_become_tables_and_drawings() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let slow = CURVE.replace("24.5", "24").replace("\n90", "\n95");
    let runs = [
        write_scores(&at("a"), "odgs", "street", Some(CURVE)),
        write_scores(&at("b"), "pvg", "street", Some(&slow)).join("result.json"),
        write_scores(&at("c"), "odgs", "hall", Some(CURVE)),
    ];
    let comparisons =
        curve::curves(&runs, Clock::Wall, Region::Whole, &at("out"), &Silent).unwrap();
    assert_eq!(comparisons.len(), 2);
    insta::assert_snapshot!("table", curve::curves_table(&comparisons));
    let (header, rows) = csv_of(&at("out").join(CURVES_FILE));
    assert_eq!(header, CURVES_HEADER);
    let cell = |row: usize, column: &str| {
        let at = header.split(',').position(|name| name == column).unwrap();
        rows[row][at].clone()
    };
    let number = |row: usize, column: &str| cell(row, column).parse::<f64>().unwrap();
    assert_eq!(cell(1, "method"), "pvg");
    assert_eq!(
        (number(1, "first_seconds"), number(1, "first_psnr_db")),
        (9.0, 19.5)
    );
    // Both curves have the time from 9 s to 90 s.
    let of_span = ["log_area_from_seconds", "log_area_until_seconds"];
    assert_eq!(of_span.map(|column| number(1, column)), [9.0, 90.0]);
    let pieces = [(19.5 + 24.25) * 5_f64.ln(), (24.25 + 24.5) * 2_f64.ln()];
    let area = 0.5 * (pieces[0] + pieces[1]) / 10_f64.ln();
    assert!((number(0, "log_area_db") - area).abs() < 1e-9);
    let pieces = [(0.5 + 0.7) * 5_f64.ln(), (0.7 + 0.75) * 2_f64.ln()];
    let ssim = 0.5 * (pieces[0] + pieces[1]) / 10_f64.ln();
    assert!((number(0, "log_area_ssim") - ssim).abs() < 1e-9);
    assert_eq!(cell(0, "log_area_lpips_alex"), "");
    // The end has 24.5 dB.
    let near = 9.0 * 5_f64.powf(4.0 / 4.75);
    assert!((number(0, "seconds_to_1_db_below_end") - near).abs() < 1e-9);
    // From 19.5 dB after 9 s to 24.25 dB after 45 s.
    let to_22 = 9.0 * 5_f64.powf(2.5 / 4.75);
    assert!((number(0, "seconds_to_22_db") - to_22).abs() < 1e-9);
    // Iterations go on evenly between rows: 350 in 36 s.
    let iterations = 100.0 + 350.0 * (to_22 - 9.0) / 36.0;
    assert_eq!(number(0, "iterations_to_22_db"), iterations.round());
    // A scene with one run has nothing to compare.
    for column in of_span
        .into_iter()
        .chain(["log_area_db", "seconds_to_26_db"])
    {
        assert_eq!(cell(2, column), "", "{column}");
    }
    let points = fs::read_to_string(at("out").join(POINTS_FILE)).unwrap();
    // Three scored rows of each run and a heading.
    assert_eq!(points.lines().count(), 10);
    for number in 0..2 {
        let drawing = fs::read_to_string(at("out").join(format!("curve-{number}.svg"))).unwrap();
        assert!(drawing.contains("training time, s"));
    }
}

#[test]
fn cpu_time_is_a_clock_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = write_scores(
        &at("a"),
        "odgs",
        "street",
        Some(&CURVE.replace("90,900", "180,900")),
    );
    let comparisons =
        curve::curves(&[run], Clock::Cpu, Region::Whole, &at("out"), &Silent).unwrap();
    let measured = &comparisons[0].curves[0];
    assert_eq!(measured.run.training_seconds, Some(180.0));
    let drawing = fs::read_to_string(at("out/curve-0.svg")).unwrap();
    assert!(drawing.contains("CPU seconds"));
    assert!(curve::curves_table(&comparisons).contains(", CPU seconds\n"));

    let unknown = CURVE.replace(",9,100,", ",,100,");
    let run = write_scores(&at("b"), "odgs", "street", Some(&unknown));
    let error = curve::curves(&[run], Clock::Cpu, Region::Whole, &at("out"), &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(
        error.to_string().contains("has a row without the CPU time"),
        "{error}"
    );
}

#[test]
fn runs_without_a_usable_curve_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        (None, "has no psnr of novel views"),
        (Some("wall_seconds,iteration\n1,2\n"), "curve.csv: "),
        (
            Some("wall_seconds,evaluation_seconds,iteration,primitives,novel_psnr_db\n1,0,2,5,\n"),
            "has no psnr of novel views",
        ),
        (
            Some(
                "wall_seconds,evaluation_seconds,iteration,primitives,novel_psnr_db\n2,0,2,5,20\n1,0,3,5,21\n",
            ),
            "goes back in time",
        ),
    ];
    for (number, (curve, expected)) in cases.into_iter().enumerate() {
        let run = write_scores(&folder.path().join(number.to_string()), "m", "s", curve);
        let error = curve::curves(
            &[run],
            Clock::Wall,
            Region::Whole,
            &folder.path().join("out"),
            &Silent,
        )
        .unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn the_folder_of_a_run_is_told_from_that_of_its_scores() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("run.json"), "{}").unwrap();
    let runs = [folder.path().to_owned()];
    let error = curve::curves(
        &runs,
        Clock::Wall,
        Region::Whole,
        &folder.path().join("out"),
        &Silent,
    )
    .unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("read from the folder of its scores"),
        "{error}"
    );
}

#[test]
fn what_a_run_was_given_took_time_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let stage = |stage: &str, wall_seconds: f64, cpu_seconds: Option<f64>| StageTime {
        stage: stage.to_owned(),
        method: None,
        took: Elapsed {
            wall_seconds,
            cpu_seconds,
        },
    };
    let whole = ResultRecord {
        stages: vec![
            stage("poses", 30.0, Some(40.0)),
            stage("dense", 50.5, Some(80.25)),
            stage("training", 90.0, Some(90.0)),
        ],
        ..record("object-graph", "crossroad")
    };
    let mut older = whole.clone();
    older.stages[0].took.cpu_seconds = None;
    let runs = [
        write_record(&at("a"), &whole, Some(CURVE)),
        write_record(&at("b"), &older, Some(CURVE)),
        write_scores(&at("c"), "odgs", "crossroad", Some(CURVE)),
    ];
    let of = |clock: Clock| {
        let found = curve::curves(&runs, clock, Region::Whole, &at("out"), &Silent).unwrap();
        let curves = &found[0].curves;
        let seconds: Vec<_> = curves
            .iter()
            .map(|curve| curve.run.preparation_seconds)
            .collect();
        (seconds, curve::curves_table(&found))
    };
    let (seconds, table) = of(Clock::Wall);
    assert_eq!(seconds, [Some(80.5), Some(80.5), None]);
    assert!(table.contains("| Before training s |"), "{table}");
    assert!(
        table
            .lines()
            .any(|line| line.starts_with("| odgs") && line.ends_with("| - |"))
    );
    assert_eq!(of(Clock::Cpu).0, [Some(120.25), None, None]);
    let curves = fs::read_to_string(at("out").join(CURVES_FILE)).unwrap();
    assert!(
        curves.contains(",preparation_seconds,training_seconds,"),
        "{curves}"
    );
}

#[test]
fn objects_and_input_views_stand_beside_novel_ones() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let further = [
        ",objects,input_psnr_db,input_psnr_dynamic_db",
        ",8,21.5,12.5",
        ",8,,",
        ",8,,",
        ",8,27,",
    ];
    let rows = CURVE.lines().zip(further);
    let traced: String = rows.map(|(row, more)| format!("{row}{more}\n")).collect();
    let run = write_scores(&at("a"), "object-graph", "crossroad", Some(&traced));
    let curves = curve::curves(&[run], Clock::Wall, Region::Whole, &at("out"), &Silent).unwrap();
    let rows = &curves[0].curves[0].run.rows;
    let input: Vec<_> = rows.iter().map(|row| row.input_psnr_db).collect();
    assert_eq!(input, [Some(21.5), None, Some(27.0)]);
    assert!(rows.iter().all(|row| row.objects == Some(8)));
}

#[test]
fn a_curve_is_of_the_region_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let further = [
        ",novel_psnr_static_db,novel_psnr_dynamic_db",
        ",22,11",
        ",,",
        ",25,",
        ",26,15.5",
    ];
    let rows = CURVE.lines().zip(further);
    let of_regions: String = rows.map(|(row, more)| format!("{row}{more}\n")).collect();
    let run = write_scores(&at("a"), "object-graph", "crossroad", Some(&of_regions));
    let of = |region| {
        let curves = curve::curves(
            std::slice::from_ref(&run),
            Clock::Wall,
            region,
            &at("out"),
            &Silent,
        )
        .unwrap();
        let rows = &curves[0].curves[0].run.rows;
        let text = curve::curves_table(&curves);
        (rows.iter().map(|row| row.psnr_db).collect::<Vec<_>>(), text)
    };
    assert_eq!(of(Region::Whole).0, [19.5, 24.25, 24.5]);
    assert_eq!(of(Region::Static).0, [22.0, 25.0, 26.0]);
    let (rows, text) = of(Region::Dynamic);
    assert_eq!(rows, [11.0, 15.5]);
    assert!(
        text.contains("where something moves") && text.contains("| 15.500 |"),
        "{text}"
    );
    let points = fs::read_to_string(at("out").join(POINTS_FILE)).unwrap();
    assert!(points.contains(",wall,dynamic,90.0,"), "{points}");
    let without = write_scores(&at("b"), "odgs", "hall", Some(CURVE));
    let error = curve::curves(
        &[without],
        Clock::Wall,
        Region::Dynamic,
        &at("out"),
        &Silent,
    )
    .unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(
        error
            .to_string()
            .contains("psnr-dynamic of novel views: the scene has no dynamic masks"),
        "{error}"
    );
}
