//! The tables as printed, and refusals.
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::support::{result, summary};
use omnilife_leaderboard::{LeaderboardError, build, collect};
use omnilife_schemas::{
    Classified, ErrorKind,
    records::{Direction, Failure, ResultRecord, ScoredRegions, Summary},
    store,
};

fn with_paths(results: Vec<ResultRecord>) -> Vec<(PathBuf, ResultRecord)> {
    let path = |r: &ResultRecord| PathBuf::from(format!("{}/{}/result.json", r.scene, r.method));
    results.into_iter().map(|r| (path(&r), r)).collect()
}

/// Both tables of some results, one below the other.
fn tables(results: Vec<ResultRecord>) -> String {
    let out = tempfile::tempdir().unwrap();
    let tables = build(&with_paths(results), &out.path().join("new/folder")).unwrap();
    assert_eq!(
        fs::read_to_string(&tables.markdown_file).unwrap(),
        tables.markdown
    );
    assert_eq!(fs::read(&tables.csv_file).unwrap(), tables.csv);
    let csv = String::from_utf8(tables.csv).unwrap();
    format!("{}\n{csv}", tables.markdown)
}

fn two_methods() -> Vec<ResultRecord> {
    vec![
        result("street", "odgs", 25.1234, 0.81),
        result("hall", "odgs", 27.5, 0.9),
        result("street", "odgs-published", 24.0, 0.82),
        result("hall", "odgs-published", 26.0, 0.85),
    ]
}

#[test]
fn one_result_is_a_table() {
    insta::assert_snapshot!(tables(vec![result(
        "street/seq-000",
        "odgs",
        25.123_45,
        0.812_34
    )]));
}

#[test]
fn methods_are_compared_per_scene_and_by_their_means() {
    insta::assert_snapshot!(tables(two_methods()));
}

/// A failed view, a scene that a method lacks, a kind of view that was not scored, odd names.
#[test]
fn incomplete_results_are_marked_and_win_nothing() {
    let mut results = two_methods();
    results[0].failures = vec![
        Failure {
            view: "novel".to_owned(),
            frame: 9,
            reason: "000009.png is missing".to_owned(),
        };
        2
    ];
    results[3].input_views.clear();
    results[3].warnings = vec!["input views were not scored: no predictions given".to_owned()];
    results[3].training_seconds = None;
    results[3].primitives = None;
    let mut third = result("hall", "mine|<b>", 40.0, 0.93);
    third.iterations = None;
    results.push(third);
    insta::assert_snapshot!(tables(results));
}

#[test]
fn protocols_never_share_a_table() {
    let mut results = two_methods();
    results[1].protocol_hash = "0".repeat(64);
    results[2].protocol = "per-scene/2".to_owned();
    results[2].protocol_hash = "1".repeat(64);
    let lower = Summary {
        mean: 0.25,
        views: 12,
        direction: Some(Direction::LowerIsBetter),
        ..summary(0.0, 1)
    };
    results[2].novel_views.insert("lpips-vgg".to_owned(), lower);
    insta::assert_snapshot!(tables(results));
}

#[test]
fn ties_after_rounding_are_all_bold() {
    let results = vec![
        result("street", "a", 25.000_1, 0.8),
        result("street", "b", 25.000_2, 0.9),
        result("street", "c", 24.0, 0.7),
    ];
    let text = tables(results);
    assert_eq!(text.matches("**25.000**").count(), 2, "{text}");
    assert_eq!(text.matches("**0.9000**").count(), 1, "{text}");
}

#[test]
fn the_order_of_results_does_not_matter() {
    let mut backwards = two_methods();
    backwards.reverse();
    assert_eq!(tables(backwards), tables(two_methods()));
}

fn refusal(results: Vec<ResultRecord>) -> String {
    let out = tempfile::tempdir().unwrap();
    let error = build(&with_paths(results), out.path()).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert_eq!(fs::read_dir(out.path()).unwrap().count(), 0);
    error.to_string()
}

#[test]
fn two_results_for_one_row_are_refused() {
    let mut results = two_methods();
    results.push(results[0].clone());
    let message = refusal(results);
    assert!(message.contains("method odgs on scene street"), "{message}");
    assert!(!message.contains('\n'), "{message}");
}

#[test]
fn one_name_for_two_scenes_is_refused() {
    let mut results = two_methods();
    results[2].scene_sha256 = store::sha256_bytes(b"the same street at another width");
    let message = refusal(results);
    assert!(
        message.contains("scene street has other frames or poses than in"),
        "{message}"
    );
    assert!(!message.contains('\n'), "{message}");
}

/// A mean of the easy views alone is not that of a scene.
#[test]
fn views_that_are_neither_scored_nor_failed_are_refused() {
    let mut results = two_methods();
    for summary in results[2].novel_views.values_mut() {
        summary.views = 9;
    }
    let message = refusal(results.clone());
    assert!(
        message.contains("every novel view of scene street, got 9 with failures")
            && message.contains("scores 12"),
        "{message}"
    );
    assert!(!message.contains('\n'), "{message}");
    let failure = |frame: u32| Failure {
        view: "novel".to_owned(),
        frame,
        reason: format!("{frame:06}.png is missing"),
    };
    results[2].failures = [4, 9, 14].map(failure).into();
    assert!(tables(results).contains("000004.png is missing"));
}

/// Scores of regions stand in the table, and not beside those of regions by other tracks.
#[test]
fn scores_by_region_are_shown_where_the_regions_are_the_same() {
    let by = |tracks: Option<&str>| {
        let mut results = two_methods();
        for (number, result) in results.iter_mut().enumerate() {
            let sha256 = tracks.filter(|_| number == 2).unwrap_or("first");
            result.regions = Some(ScoredRegions {
                source: "tracks".to_owned(),
                sha256: sha256.to_owned(),
            });
            let regions = [("psnr-static", 30.5), ("psnr-dynamic", 20.125)];
            for (metric, score) in regions {
                result
                    .novel_views
                    .insert(metric.to_owned(), summary(score, 12));
            }
        }
        tables(results)
    };
    let same = by(None);
    assert!(
        same.contains("Novel PSNR-STATIC ↑ | Novel PSNR-DYNAMIC ↑"),
        "{same}"
    );
    assert!(
        same.contains("20.125") && !same.contains("left out"),
        "{same}"
    );
    let other = by(Some("second"));
    assert!(
        other.contains("left out for street: methods were scored with other tracks"),
        "{other}"
    );
}

#[test]
fn contradicting_directions_are_refused() {
    let mut results = two_methods();
    let psnr = results[1].novel_views.get_mut("psnr").unwrap();
    psnr.direction = Some(Direction::LowerIsBetter);
    assert!(refusal(results).contains("says that psnr is better when"));
}

#[test]
fn no_results_are_refused() {
    assert!(refusal(Vec::new()).contains("holds no result.json"));
}

fn write(folder: &Path, result: &ResultRecord) -> PathBuf {
    fs::create_dir_all(folder).unwrap();
    let path = folder.join("result.json");
    store::write_record(&path, result).unwrap();
    path
}

#[test]
fn results_are_found_below_a_folder_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let results = two_methods();
    let second = write(&folder.path().join("b/deep/er"), &results[0]);
    let first = write(&folder.path().join("a"), &results[1]);
    let third = write(folder.path(), &results[2]);
    fs::write(folder.path().join("a/other.json"), "{}").unwrap();
    let found = collect(folder.path()).unwrap();
    let paths: Vec<_> = found.iter().map(|(path, _)| path.clone()).collect();
    assert_eq!(paths, [first, second, third]);
    assert_eq!(found[1].1, results[0]);
}

#[cfg(unix)]
#[test]
fn links_are_followed_once() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    write(elsewhere.path(), &two_methods()[0]);
    symlink(elsewhere.path(), folder.path().join("link")).unwrap();
    symlink(elsewhere.path(), folder.path().join("same")).unwrap();
    symlink(folder.path(), elsewhere.path().join("circle")).unwrap();
    let found = collect(folder.path()).unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].0, folder.path().join("link/result.json"));
}

#[test]
fn broken_and_missing_results_are_told() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(
        collect(folder.path()),
        Err(LeaderboardError::NoResults { .. })
    ));
    assert!(collect(&folder.path().join("nowhere")).is_err());
    let path = write(&folder.path().join("a"), &two_methods()[0]);
    write(&folder.path().join("b"), &two_methods()[1]);
    fs::write(&path, "{").unwrap();
    let error = collect(folder.path()).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().starts_with(path.to_str().unwrap()));
}

/// Names come from others: in a spreadsheet they are not formulas, on a page no images.
#[test]
fn names_of_methods_are_text_wherever_they_are_shown() {
    let names = ["=cmd|' /C calc'!A0", "![](https://example.org/p.png)"];
    let shown = tables(names.map(|name| result("street", name, 20.0, 0.5)).to_vec());
    assert!(shown.contains("'=cmd|' /C calc'!A0"), "{shown}");
    assert!(!shown.contains(",=cmd"), "{shown}");
    let escaped = "\\!\\[\\](https://example.org/p.png)";
    assert!(shown.contains(escaped), "{shown}");
    assert!(!shown.contains("| ![]("), "{shown}");
}
