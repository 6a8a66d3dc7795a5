//! Aids of rows that stand side by side.

use std::path::PathBuf;

use crate::{leaderboard::Place, support::result};
use omnilife_leaderboard::{Tables, build};
use omnilife_schemas::records::ResultRecord;

/// Returns a result whose method can have these aids, each with true where it was used.
fn row(scene: &str, method: &str, aids: &[(&str, bool)]) -> ResultRecord {
    let aids = aids.iter().map(|&(aid, used)| (aid.to_owned(), used));
    ResultRecord {
        aids: Some(aids.collect()),
        ..result(scene, method, 25.0, 0.8)
    }
}

fn tables(results: &[ResultRecord]) -> Tables {
    let out = tempfile::tempdir().unwrap();
    let path = |r: &ResultRecord| PathBuf::from(format!("{}/{}/result.json", r.scene, r.method));
    let results: Vec<_> = results.iter().map(|r| (path(r), r.clone())).collect();
    build(&results, out.path()).unwrap()
}

const UNEQUAL: &str = "Not compared with equal aids";

#[test]
fn rows_with_equal_aids_are_told_and_not_warned_of() {
    let tables = tables(&[
        row("street", "odgs", &[("short-schedule", true)]),
        row(
            "street",
            "omni4dgs",
            &[("short-schedule", true), ("mask-seeds", true)],
        ),
        // Of another program: nothing is known.
        result("street", "theirs", 24.0, 0.8),
    ]);
    for text in [&tables.markdown, &tables.short] {
        assert!(!text.contains(UNEQUAL), "{text}");
        assert!(text.contains("short-schedule (odgs)"), "{text}");
        assert!(
            text.contains("mask-seeds, short-schedule (omni4dgs)"),
            "{text}"
        );
    }
}

#[test]
fn an_aid_on_one_side_is_warned_of_unless_a_bare_row_stands_beside_it() {
    let aided = row(
        "street",
        "plus",
        &[("dropout", true), ("short-schedule", true)],
    );
    let bare = row(
        "street",
        "plus-without-aids",
        &[("dropout", false), ("short-schedule", false)],
    );
    let other = |used| {
        row(
            "street",
            "odgs",
            &[("dropout", false), ("short-schedule", used)],
        )
    };
    let alone = tables(&[aided.clone(), other(true)]);
    for text in [&alone.markdown, &alone.short] {
        assert!(text.contains(UNEQUAL), "{text}");
        assert!(text.contains("odgs and plus (dropout)"), "{text}");
    }
    // On one scene alone the warning stays.
    let hall = [("short-schedule", false)];
    for (rows, is_warned) in [
        (vec![aided.clone(), bare.clone(), other(false)], false),
        (vec![aided.clone(), bare.clone(), other(true)], true),
        (
            vec![
                aided,
                bare,
                other(false),
                row("hall", "plus", &[("short-schedule", true)]),
                row("hall", "odgs", &hall),
            ],
            true,
        ),
    ] {
        let text = tables(&rows).markdown;
        assert_eq!(text.contains(UNEQUAL), is_warned, "{text}");
    }
}

#[test]
fn other_constants_are_a_variant_and_no_other_method() {
    let rows = [
        row("street", "odgs", &[("short-schedule", true)]),
        row("street", "omni4dgs", &[("short-schedule", true)]),
        row(
            "street",
            "omni4dgs-set-gamma=1",
            &[("short-schedule", false)],
        ),
    ];
    let text = tables(&rows).markdown;
    assert!(!text.contains(UNEQUAL), "{text}");
}

/// The names `theirs` and `theirs-with-depth` are of another program, which lists no aids.
#[test]
fn variants_of_a_method_are_rows_of_its_ablation_and_not_ranked() {
    let ours = |method| row("street", method, &[("short-schedule", true)]);
    let place = Place::with(&[
        ours("odgs"),
        ours("odgs-with-dropout-without-sky-shell"),
        ours("odgs-set-gamma=-1"),
        ours("odgs-plan-auto"),
        ours("nag-with-flow"),
        result("street", "theirs", 24.0, 0.8),
        result("street", "theirs-with-depth", 26.0, 0.8),
    ]);
    place.build();
    let rows = |text: &str, names: &[&str]| {
        let cells = text.lines().filter_map(|line| line.split('|').nth(1));
        let cells: Vec<&str> = cells.map(str::trim).collect();
        names.iter().filter(|name| cells.contains(name)).count()
    };
    let views = place.layout("views.md");
    let ranked = ["odgs", "nag-with-flow", "theirs", "theirs-with-depth"];
    assert_eq!(rows(&views, &ranked), 4, "{views}");
    assert!(views.contains("3 variants stand"), "{views}");
    let ablation = place.layout("ablation.md");
    let listed = [
        "odgs (full)",
        "with dropout, w/o sky shell",
        "gamma=-1",
        "plan auto",
    ];
    assert_eq!(rows(&ablation, &listed), 4, "{ablation}");
    assert!(!ablation.contains("theirs"), "{ablation}");
}

#[test]
fn results_that_say_nothing_have_no_line() {
    let text = tables(&[result("street", "odgs", 25.0, 0.8)]).markdown;
    assert!(!text.contains("Aids") && !text.contains(UNEQUAL), "{text}");
}
