//! Questions to results, and the tables of values beside a board.

use std::{
    collections::BTreeMap,
    fs::{self, File},
};

use omnilife_leaderboard::{Answer, AnswerFormat, QueryRequest, render, results_table};
use omnilife_results::Values;
use omnilife_schemas::{
    frame_scores::{FrameRow, FrameScores},
    records::{Failure, ResultRecord, ScoredRegions},
};
use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::Field,
};

use crate::{
    leaderboard::Place,
    support::{result, summary, write},
};

fn ask(place: &Place, table_name: &str, by: &[&str], conditions: &[&str]) -> Answer {
    question(place, table_name, by, &["psnr"], conditions).unwrap()
}

fn question(
    place: &Place,
    table_name: &str,
    by: &[&str],
    metrics: &[&str],
    conditions: &[&str],
) -> Result<Answer, omnilife_leaderboard::LeaderboardError> {
    let owned = |texts: &[&str]| texts.iter().map(|&text| text.to_owned()).collect();
    omnilife_leaderboard::query(&QueryRequest {
        results: place.request.results.clone(),
        dataset: None,
        table: results_table(table_name).unwrap(),
        by: owned(by),
        metrics: owned(metrics),
        conditions: owned(conditions),
    })
}

fn texts(answer: &Answer, name: &str) -> Vec<String> {
    match values(answer, name) {
        Values::Text(values) => values.iter().flatten().cloned().collect(),
        other => panic!("{name} is {other:?}"),
    }
}

fn numbers(answer: &Answer, name: &str) -> Vec<Option<f64>> {
    match values(answer, name) {
        Values::Number(values) => values.clone(),
        Values::Count(values) => (values.iter())
            .map(|value| value.map(|value| value as f64))
            .collect(),
        other => panic!("{name} is {other:?}"),
    }
}

fn values<'a>(answer: &'a Answer, name: &str) -> &'a Values {
    let column = answer.columns.iter().find(|column| column.name == name);
    &column.unwrap().values
}

fn seeded(scene: &str, method: &str, seed: u64, psnr: f64) -> ResultRecord {
    ResultRecord {
        seed: Some(seed),
        ..result(scene, method, psnr, 0.9)
    }
}

#[test]
fn repetitions_weigh_the_same_then_scenes() {
    let place = Place::with(&[
        seeded("park/seq-000", "a", 0, 20.0),
        seeded("park/seq-000", "a", 1, 22.0),
        seeded("park/seq-000", "a", 2, 24.0),
        seeded("park/seq-001", "a", 0, 30.0),
        seeded("hall/seq-000", "a", 0, 10.0),
        seeded("park/seq-000", "b", 0, 40.0),
    ]);
    let all = ask(&place, "results", &[], &["view=novel"]);
    assert_eq!(texts(&all, "method"), ["b", "a"]);
    let expected = (22.0 + 30.0 + 10.0) / 3.0;
    assert_eq!(numbers(&all, "psnr"), [Some(40.0), Some(expected)]);
    assert_eq!(numbers(&all, "psnr_scenes"), [Some(1.0), Some(3.0)]);
    assert_eq!(numbers(&all, "of_scenes"), [Some(3.0), Some(3.0)]);
    // A single scene has no deviation.
    let deviations = numbers(&all, "psnr_sd");
    assert_eq!(deviations[0], None);
    assert!((deviations[1].unwrap() - 10.066_445_9).abs() < 1e-6);

    let by_video = ask(&place, "results", &["video"], &["view=novel", "method=a"]);
    assert_eq!(texts(&by_video, "video"), ["hall", "park"]);
    assert_eq!(numbers(&by_video, "psnr"), [Some(10.0), Some(26.0)]);
}

/// Grouping by hand, in the tables of a board, and by the library is the same to the last bit.
#[test]
fn means_equal_those_of_the_board() {
    let mut results = Vec::new();
    for (at, scene) in ["a/seq-000", "a/seq-001", "b/seq-000"]
        .into_iter()
        .enumerate()
    {
        for (of, method) in ["x", "y", "z"].into_iter().enumerate() {
            for seed in 0..3 {
                let wave = ((7 * at + 3 * of) as f64 + 1.3 * seed as f64).sin();
                results.push(seeded(scene, method, seed, 25.0 + 3.0 * wave));
            }
        }
    }
    let place = Place::with(&results);
    place.build();
    let mut board = BTreeMap::new();
    for row in csv::Reader::from_reader(place.read("table.csv").as_bytes()).into_deserialize() {
        let row: BTreeMap<String, String> = row.unwrap();
        if row["row"] == "mean" {
            let both = [&row["novel_psnr"], &row["input_ssim"]];
            board.insert(
                row["method"].clone(),
                both.map(|text| text.parse().unwrap()),
            );
        }
    }
    let answer = question(&place, "results", &[], &["psnr", "ssim"], &[]).unwrap();
    let (methods, views) = (texts(&answer, "method"), texts(&answer, "view"));
    let (psnr, ssim) = (numbers(&answer, "psnr"), numbers(&answer, "ssim"));
    assert_eq!(methods.len(), 6);
    for row in 0..methods.len() {
        let expected: [f64; 2] = board[&methods[row]];
        let (found, expected) = match views[row].as_str() {
            "novel" => (psnr[row], expected[0]),
            _ => (ssim[row], expected[1]),
        };
        assert_eq!(format!("{:.6}", found.unwrap()), format!("{expected:.6}"));
    }
}

#[test]
fn views_are_asked_by_thirds_and_by_distance() {
    let place = Place::with(&[]);
    let of_views = |novel: Option<(f64, u32)>, input: Option<(f64, u32)>| {
        let scores = |of: Option<(f64, u32)>| {
            let of = of.map(|(mean, views)| ("psnr".to_owned(), summary(mean, views)));
            of.into_iter().collect()
        };
        ResultRecord {
            novel_views: scores(novel),
            input_views: scores(input),
            ..result("park", "a", 20.0, 0.9)
        }
    };
    let of_all = of_views(Some((68.0 / 3.0, 3)), Some((50.0, 2)));
    let folder = write(&place.request.results, &of_all);
    let row = |frame: u32, view: &str, psnr: Option<f64>| FrameRow {
        view: view.to_owned(),
        frame,
        time_seconds: f64::from(frame),
        distance_to_given: Some(0.3 * f64::from(frame % 4)),
        scores: vec![psnr],
    };
    let scores = FrameScores {
        metrics: vec!["psnr".to_owned()],
        rows: vec![
            row(0, "input", Some(50.0)),
            row(1, "novel", Some(20.0)),
            row(2, "novel", Some(30.0)),
            row(5, "novel", Some(18.0)),
            row(7, "novel", None),
            row(9, "input", Some(50.0)),
        ],
    };
    scores.write(&folder.join("frames.csv")).unwrap();
    let thirds = ask(&place, "views", &["third"], &["view=novel"]);
    // From the first novel view to the last one: input views, which not every method has, shift no bounds.
    assert_eq!(numbers(&thirds, "third"), [Some(1.0), Some(3.0)]);
    assert_eq!(numbers(&thirds, "psnr"), [Some(25.0), Some(18.0)]);
    assert_eq!(thirds.notes, [""; 0]);
    let steps = ask(&place, "views", &["distance-to-given:0.5"], &["view=novel"]);
    assert_eq!(numbers(&steps, "distance_to_given"), [Some(0.0), Some(0.5)]);
    assert_eq!(numbers(&steps, "psnr"), [Some(19.0), Some(30.0)]);
    let near = ask(
        &place,
        "views",
        &[],
        &["distance_to_given<=0.3", "frame!=0,9"],
    );
    assert_eq!(numbers(&near, "psnr"), [Some(19.0)]);

    // Views of one time have no third, and a note says so.
    let at_once = FrameScores {
        rows: vec![row(2, "novel", Some(30.0))],
        ..scores
    };
    at_once.write(&folder.join("frames.csv")).unwrap();
    // A table of other views than the means are of is refused.
    let changed = question(&place, "views", &["third"], &["psnr"], &[]).unwrap_err();
    assert!(changed.to_string().contains("is a mean of"), "{changed}");
    write(&place.request.results, &of_views(Some((30.0, 1)), None));
    let thirds = ask(&place, "views", &["third"], &["view=novel"]);
    assert_eq!(numbers(&thirds, "third"), [None]);
    assert_eq!(thirds.notes.len(), 1);
    assert!(thirds.notes[0].starts_with("third is empty in 1 of 1 rows"));
}

#[test]
fn curves_are_asked_by_iteration() {
    let place = Place::with(&[]);
    for (method, level) in [("a", 20.0), ("b", 21.0)] {
        let folder = write(&place.request.results, &result("park", method, 20.0, 0.9));
        let later = level + 4.0;
        let text = format!(
            "wall_seconds,cpu_seconds,iteration,novel_psnr_db,novel_psnr_dynamic_db\n\
             1,,10,{level},12\n2,3,20,{later},\n"
        );
        fs::write(folder.join("curve.csv"), text).unwrap();
    }
    let answer = ask(&place, "curves", &[], &["region=whole"]);
    assert_eq!(
        numbers(&answer, "iteration"),
        [10.0, 10.0, 20.0, 20.0].map(Some)
    );
    assert_eq!(texts(&answer, "method"), ["b", "a", "b", "a"]);
    assert_eq!(numbers(&answer, "psnr"), [21.0, 20.0, 25.0, 24.0].map(Some));
}

/// The results are of twelve novel views; curves of one, as `--trace-views 1` leaves them, do not compare with others.
#[test]
fn curves_of_other_views_than_the_scores_are_left_out() {
    let place = Place::with(&[]);
    for (method, views) in [("a", "12"), ("b", "1"), ("older", "")] {
        let folder = write(&place.request.results, &result("park", method, 20.0, 0.9));
        let row = format!("wall_seconds,iteration,novel_views,novel_psnr_db\n1,10,{views},20\n");
        fs::write(folder.join("curve.csv"), row).unwrap();
    }
    let answer = ask(&place, "curves", &[], &["region=whole"]);
    let mut methods = texts(&answer, "method");
    methods.sort_unstable();
    assert_eq!(methods, ["a", "older"]);
    let notes = answer.notes.concat();
    assert_eq!(notes.matches("b on park (1 views)").count(), 1, "{notes}");
}

#[test]
fn incomplete_results_are_left_out_unless_they_are_asked_for() {
    let failed = ResultRecord {
        failures: vec![Failure {
            view: "novel".to_owned(),
            frame: 3,
            reason: "not there".to_owned(),
        }],
        ..result("hall", "a", 5.0, 0.1)
    };
    let place = Place::with(&[result("park", "a", 20.0, 0.9), failed]);
    let whole = ask(&place, "results", &[], &["view=novel"]);
    assert_eq!(numbers(&whole, "psnr"), [Some(20.0)]);
    assert_eq!(whole.notes.len(), 1);
    assert!(whole.notes[0].starts_with("1 of 2 results"));
    let both = ask(&place, "results", &["complete"], &["view=novel"]);
    assert_eq!(numbers(&both, "psnr"), [Some(5.0), Some(20.0)]);
    assert_eq!(both.notes, [""; 0]);
}

#[test]
fn questions_that_cannot_be_asked_say_what_can() {
    let place = Place::with(&[result("park", "a", 20.0, 0.9)]);
    for (by, metric, condition, expected) in [
        ("colour", "psnr", "view=novel", "ego_motion"),
        ("metric", "psnr", "view=novel", "--metric"),
        ("third", "psnr", "view=novel", "third"),
        ("video:2", "psnr", "view=novel", "step"),
        ("video", "psnrr", "view=novel", "psnr, ssim"),
        ("video", "psnr", "view", "expected a column"),
        ("video", "psnr", "scene<4", "column of numbers"),
        ("video", "psnr", "iterations=x", "iterations is a count"),
        ("video", "psnr", "metric=ssim", "--metric"),
        ("video", "psnr", "view=other", "meets view=other"),
    ] {
        let error = question(&place, "results", &[by], &[metric], &[condition]).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(expected),
            "{by} {metric} {condition}: {error}"
        );
        assert_eq!(error.lines().count(), 1);
    }
}

#[test]
fn answers_have_four_formats() {
    let place = Place::with(&[
        result("park", "a,b", 20.25, 0.9),
        result("hall", "a,b", 30.0, 0.8),
    ]);
    let answer = ask(&place, "results", &["scene"], &["view=novel"]);
    let text = |format| String::from_utf8(render(&answer, format).unwrap()).unwrap();
    let table = text(AnswerFormat::Table);
    assert!(
        table.starts_with("protocol per-scene/1, protocol_hash a34df006b285…,"),
        "{table}"
    );
    assert!(table.contains("| park  | a,b    | 20.250 |"), "{table}");
    let csv = text(AnswerFormat::Csv);
    assert!(csv.contains(",park,\"a,b\",20.25,,1,1\n"), "{csv}");
    let json: serde_json::Value = serde_json::from_str(&text(AnswerFormat::Json)).unwrap();
    assert_eq!(json[1]["psnr"], 20.25);
    assert!(json[1]["psnr_sd"].is_null());
    let file = place.request.results.join("answer.parquet");
    fs::write(&file, render(&answer, AnswerFormat::Parquet).unwrap()).unwrap();
    assert_eq!(
        column(&file, "psnr"),
        [Field::Double(30.0), Field::Double(20.25)]
    );
}

/// The values of a column of a Parquet file.
fn column(file: &std::path::Path, name: &str) -> Vec<Field> {
    let reader = SerializedFileReader::new(File::open(file).unwrap()).unwrap();
    let rows = reader.get_row_iter(None).unwrap();
    rows.map(|row| {
        let row = row.unwrap();
        let (_, field) = row.get_column_iter().find(|(own, _)| *own == name).unwrap();
        field.clone()
    })
    .collect()
}

#[test]
fn tables_of_values_lie_beside_the_board_whatever_the_order_of_results() {
    let results = [
        seeded("park", "a", 3, 20.0),
        seeded("park", "b", 0, 21.0),
        result("hall", "a", 22.0, 0.5),
    ];
    let place = Place::with(&results);
    place.build();
    let file = place.request.out.join("results.parquet");
    let values = column(&file, "value");
    assert_eq!(values.len(), 12);
    assert_eq!(values[0], Field::Double(25.0));
    let seeds = column(&file, "seed");
    assert_eq!(
        (&seeds[0], &seeds[4]),
        (&Field::Null, &Field::Str("3".to_owned()))
    );
    assert!(!place.request.out.join("views.parquet").exists());

    let mut turned = results.to_vec();
    turned.reverse();
    let other = Place::with(&turned);
    other.build();
    let bytes = |place: &Place| fs::read(place.request.out.join("results.parquet")).unwrap();
    assert_eq!(bytes(&place), bytes(&other));
}

#[test]
fn scenes_are_counted_by_metric_and_metrics_named_twice_are_one() {
    let mut without = result("hall", "a", 20.0, 0.9);
    without.novel_views.remove("ssim");
    let place = Place::with(&[result("park", "a", 30.0, 0.8), without]);
    let metrics = ["psnr", " ssim", "psnr"];
    let answer = question(&place, "results", &[], &metrics, &["view=novel"]).unwrap();
    assert_eq!(numbers(&answer, "psnr"), [Some(25.0)]);
    assert_eq!(numbers(&answer, "psnr_scenes"), [Some(2.0)]);
    assert_eq!(numbers(&answer, "ssim_scenes"), [Some(1.0)]);
}

/// Same rule as in the tables of a board: all repetitions of a method on a scene count, or none.
#[test]
fn a_scene_with_an_incomplete_repetition_is_left_out_whole() {
    let mut failed = seeded("hall", "a", 1, 99.0);
    failed.run_failure = Some("no memory".to_owned());
    let place = Place::with(&[
        seeded("hall", "a", 0, 10.0),
        failed,
        seeded("park", "a", 0, 30.0),
    ]);
    let answer = ask(&place, "results", &[], &["view=novel"]);
    assert_eq!(numbers(&answer, "psnr"), [Some(30.0)]);
    assert!(answer.notes[0].starts_with("2 of 3 results"));
}

#[test]
fn regions_by_other_tracks_do_not_stand_beside_each_other() {
    let of_tracks = |method: &str, sha256: &str| {
        let mut result = result("park", method, 20.0, 0.9);
        let dynamic = result.novel_views["psnr"];
        result
            .novel_views
            .insert("psnr-dynamic".to_owned(), dynamic);
        result.regions = Some(ScoredRegions {
            source: "tracks".to_owned(),
            sha256: sha256.to_owned(),
        });
        result
    };
    let place = Place::with(&[of_tracks("a", "1"), of_tracks("b", "2")]);
    let answer = ask(&place, "results", &[], &["view=novel"]);
    assert_eq!(texts(&answer, "region"), ["whole", "whole"]);
    assert_eq!(answer.notes.len(), 1);
    let same = Place::with(&[of_tracks("a", "1"), of_tracks("b", "1")]);
    let answer = ask(&same, "results", &[], &["view=novel"]);
    assert_eq!(answer.height(), 4);
    assert_eq!(answer.notes.len(), 0);
}

#[test]
fn questions_of_a_dataset_say_that_none_is_known() {
    let place = Place::with(&[result("park", "a", 20.0, 0.9)]);
    let answer = ask(&place, "results", &["ego-motion"], &["view=novel"]);
    assert!(answer.notes[0].contains("--dataset"), "{:?}", answer.notes);
}

/// Large seeds are not numbers of every table, and a table of views lies beside its result.
#[test]
fn results_of_others_are_read_with_care() {
    let place = Place::with(&[seeded("park", "a", u64::MAX, 20.0)]);
    let answer = ask(&place, "results", &["seed"], &["view=novel"]);
    assert_eq!(texts(&answer, "seed"), [u64::MAX.to_string()]);
    let mut outside = result("hall", "a", 20.0, 0.9);
    outside.frames_table = "../frames.csv".to_owned();
    let place = Place::with(&[outside]);
    let error = question(&place, "views", &[], &["psnr"], &[]).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("must be a relative path inside its folder"),
        "{error}"
    );
}

/// Every column stands in the documentation as it is, and no table has two of one name.
#[test]
fn columns_are_documented_and_have_one_name_each() {
    let page = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../docs/reference/result-tables.md"
    );
    let page = fs::read_to_string(page).unwrap();
    for name in ["results", "views", "objects", "curves"] {
        let table = results_table(name).unwrap();
        let mut names: Vec<&str> = table.columns().map(|column| column.name).collect();
        for column in table.columns() {
            let row = format!(
                "| `{}` | {} | {} |",
                column.name,
                column.kind(),
                column.about
            );
            assert!(
                page.contains(&row),
                "docs/reference/result-tables.md lacks {row}"
            );
        }
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all, "{name}");
    }
}

/// Names of methods may hold commas.
#[test]
fn a_value_in_quotes_is_one() {
    let place = Place::with(&[]);
    for (method, psnr) in [("ours, v2", 20.0), ("ours", 30.0), ("v2", 40.0)] {
        write(&place.request.results, &result("park", method, psnr, 0.9));
    }
    let asked = |condition: &str| {
        let answer = ask(&place, "results", &["method"], &["view=novel", condition]);
        let mut methods = texts(&answer, "method");
        methods.sort();
        methods
    };
    assert_eq!(asked("method=\"ours, v2\""), ["ours, v2"]);
    assert_eq!(asked("method=ours, v2"), ["ours", "v2"]);
    assert_eq!(asked("method!=\"ours, v2\",v2"), ["ours"]);
}

/// An answer has the warnings that a board has.
#[test]
fn answers_have_the_warnings_of_boards() {
    let place = Place::with(&[]);
    for (seed, iterations) in [(0, 20), (1, 40)] {
        let seeded = ResultRecord {
            seed: Some(seed),
            iterations: Some(iterations),
            ..result("park", "a", 20.0, 0.9)
        };
        write(&place.request.results, &seeded);
    }
    let notes = ask(&place, "results", &[], &["view=novel"]).notes;
    assert!(notes.concat().contains("park, a (20 and 40)"), "{notes:?}");
}
