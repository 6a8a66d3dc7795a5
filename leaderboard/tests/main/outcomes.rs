//! Ends of runs, and classes of methods, in every output.
use std::fs;

use crate::{
    leaderboard::{Place, files, study, texts},
    support::{result, summary},
};
use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard};
use omnilife_schemas::records::{
    QUICK_LOOK, ResultRecord, RunStatement, StatedClock, TrainingKind, Unavailable,
};

const REASON: &str = "prepare ended with conda could not be started";

/// A run that failed and left views with scores better than all others, which must stay hidden.
fn failed(scene: &str, method: &str) -> ResultRecord {
    let mut result = result(scene, method, 91.375, 0.98765);
    result.run_failure = Some(REASON.to_owned());
    result.training_seconds = Some(7_777.7);
    result.rendering_seconds = Some(8_888.8);
    result.primitives = Some(987_654);
    result
}

const SCENES: [&str; 4] = [
    "lake/seq-000",
    "market/seq-000",
    "market/seq-001",
    "urban-street/seq-000",
];

#[test]
fn a_failed_run_has_no_score_rank_or_mean_in_any_output() {
    for failing in [1, SCENES.len()] {
        let mut results = study();
        for (number, scene) in SCENES.into_iter().enumerate() {
            results.push(match number < failing {
                true => failed(scene, "crashed"),
                false => result(scene, "crashed", 80.125, 0.95),
            });
        }
        let place = Place::with(&results);
        place.build();
        for (path, text) in texts(&place.request.out) {
            let path = path.display();
            let numbers = ["91.375", "94.375", "0.98765", "7777.7", "8888.8", "987,654"];
            for number in numbers {
                assert!(!text.contains(number), "{path}: {number}");
            }
            let contests = text.lines().filter(|line| line.contains("crashed"));
            for line in contests.filter(|_| failing == SCENES.len()) {
                for mark in ["**", "\\textbf", "\\underline", ",best,", ",second,"] {
                    assert!(!line.contains(mark), "{path}: {line}");
                }
            }
        }
        // Means over scenes of which one failed are not means.
        for layout in ["views.md", "dynamic-scenes.md"] {
            let table = place.layout(layout);
            let row = table.lines().find(|line| line.starts_with("| crashed "));
            let average = row.unwrap().split('|').nth(3).unwrap();
            assert!(average.trim() == "–", "{layout}: {row:?}");
        }
        let views = place.layout("views.md");
        let row = views.lines().find(|line| line.starts_with("| crashed † "));
        assert!(row.unwrap().contains(" failed |"), "{row:?}");
        assert!(views.contains("| 1 of 3 |"), "{views}");
        for file in ["views.md", "views.tex", "dynamic-scenes.md", "4dgs.md"] {
            assert!(place.layout(file).contains(REASON), "{file}");
        }
        for file in ["table.md", "table.csv", "site/index.html"] {
            assert!(place.read(file).contains(REASON), "{file}");
        }
        let mut pages = files(&place.request.out.join("site"));
        pages.retain(|(path, bytes)| {
            let folder = path.parent().unwrap();
            let is_below = folder.ends_with("scenes") || folder.ends_with("methods");
            is_below && String::from_utf8_lossy(bytes).contains(REASON)
        });
        assert_eq!(pages.len(), failing + 1, "the scenes and the method");
    }
}

/// A method of one class is best of nothing, however it stands among the others.
#[test]
fn classes_share_no_contest_in_any_output() {
    let of_class = |method: &str, psnr: f64, training: Option<TrainingKind>| {
        let mut result = result("hall/seq-000", method, psnr, 0.5 + psnr / 100.0);
        // The statement decides; what else would be inferred is another class.
        result.training = training;
        if training != Some(TrainingKind::WithoutTraining) {
            result.iterations = None;
            result.training_seconds = None;
        }
        result
    };
    let mut results = vec![
        of_class("unsaid", 33.0, None),
        of_class("sweep", 31.0, Some(TrainingKind::WithoutTraining)),
        of_class("trained", 29.0, Some(TrainingKind::PerScene)),
    ];
    let marks = ["**2", "**3", "\\textbf", "title=\"best\"", ",best,"];
    let place = Place::with(&results);
    place.build();
    for (path, text) in texts(&place.request.out) {
        for mark in marks {
            assert!(!text.contains(mark), "{}: {mark}", path.display());
        }
    }
    // Rank and scenes of each.
    assert_eq!(place.layout("views.md").matches("| 1 of 1 |").count(), 6);

    results.push(of_class(
        "nearest",
        30.0,
        Some(TrainingKind::WithoutTraining),
    ));
    let place = Place::with(&results);
    let page = place.request.out.with_file_name("README.md");
    let markers = "<!-- leaderboard: begin -->\n<!-- leaderboard: end -->\n";
    fs::write(&page, markers).unwrap();
    let request = LeaderboardRequest {
        page: Some(page.clone()),
        ..place.request.clone()
    };
    let built = build_leaderboard(&request).unwrap();
    let order = [
        "Trained per scene",
        "trained",
        "Without training",
        "sweep",
        "nearest",
        "Training not stated",
        "unsaid",
    ];
    let texts = [
        place.read("table.md"),
        place.layout("views.md"),
        place.layout("views.tex"),
        fs::read_to_string(&page).unwrap(),
        built.short,
    ];
    for text in texts {
        assert!(text.contains("by novel PSNR, best first"), "{text}");
        let mut rest = text.as_str();
        for name in order {
            let at = rest.find(name);
            rest = &rest[at.unwrap_or_else(|| panic!("no {name} here: {text}"))..];
        }
        let best = text.contains("**31.000**") || text.contains("\\textbf{31.000}");
        let others = ["**33", "**29", "\\textbf{33", "\\textbf{29"];
        assert!(best && !others.iter().any(|mark| text.contains(mark)));
    }
    let index = place.read("site/index.html");
    let headings: Vec<usize> = ["Trained per scene", "Without training", "Training not"]
        .iter()
        .map(|class| index.find(&format!("<h3>{class}")).unwrap())
        .collect();
    assert!(headings.is_sorted(), "{headings:?}");
    let card = "trained per scene: trained, 29.00 dB; without training: sweep, 31.00 dB";
    assert!(index.contains(card), "{index}");
}

/// Suspicions come before everything else; a line of many results is one line.
#[test]
fn warnings_are_merged_and_the_weightiest_come_first() {
    let suspicion = "check the convention: 7.6 dB better with red and blue swapped";
    let mut results: Vec<ResultRecord> = SCENES
        .into_iter()
        .flat_map(|scene| ["a", "b"].map(|method| result(scene, method, 20.0, 0.5)))
        .collect();
    for result in &mut results {
        result.warnings.push("the poses were given".to_owned());
    }
    results[0].warnings.push("a lone remark".to_owned());
    results[1].warnings.push(suspicion.to_owned());
    let place = Place::with(&results);
    place.build();
    let table = place.read("table.md");
    let notes = || table.lines().filter(|line| line.contains("the poses were"));
    assert_eq!(notes().count(), 1, "{table}");
    assert!(notes().all(|line| line.starts_with("8 results: ")));
    assert!(table.contains("lake/seq-000, a: a lone remark"));
    for text in [table.clone(), place.layout("views.md")] {
        let first_note = text.split("\n\n").find(|paragraph| {
            let is_table = paragraph.starts_with('|');
            !is_table && !paragraph.trim_start().starts_with('#')
        });
        let expected = format!("lake/seq-000, b: {suspicion}");
        assert_eq!(first_note, Some(expected.as_str()), "{text}");
        assert!(text.contains("| b ¶ "), "{text}");
    }
    let pages = files(&place.request.out.join("site/scenes"));
    for (path, bytes) in pages {
        let page = String::from_utf8(bytes).unwrap();
        let warning = page.find("class=\"warning\"");
        let is_suspect = path.to_string_lossy().contains("lake");
        assert_eq!(warning.is_some(), is_suspect, "{}", path.display());
        assert!(warning.is_none_or(|at| at < page.find("<table").unwrap()));
    }
}

#[test]
fn stated_numbers_and_other_clocks_are_told() {
    let mut stated = result("hall", "theirs", 25.0, 0.8);
    stated.statement = Some(RunStatement {
        numbers: vec!["training_seconds".to_owned()],
        clock: Some(StatedClock::Gpu),
        hardware: Some("one <GPU>".to_owned()),
        code: Some("https://example.org/theirs".to_owned()),
    });
    let measured = result("hall", "ours", 24.0, 0.8);
    let place = Place::with(&[stated, measured]);
    place.build();
    for (text, printed) in [
        (place.read("table.md"), " 61.2 GPU § |"),
        (place.layout("views.md"), " 61.2 GPU § |"),
        (place.layout("views.tex"), "& 61.2 GPU \\S{} &"),
        (place.read("site/index.html"), ">61.2 GPU §</td>"),
    ] {
        assert_eq!(text.matches(printed).count(), 1, "{text}");
        assert!(text.contains("As the authors state"), "{text}");
    }
    let csv = place.read("table.csv");
    assert!(csv.contains(",training_seconds,GPU\n"), "{csv}");
    let page = files(&place.request.out.join("site/methods"))
        .into_iter()
        .find(|(path, _)| path.to_string_lossy().contains("theirs"));
    let page = String::from_utf8(page.unwrap().1).unwrap();
    assert!(page.contains("one &lt;GPU&gt; (as its authors state)"));
    assert!(page.contains("href=\"https://example.org/theirs\""));
}

/// A partial score does not stand for the whole protocol: it is marked, and its method is not ranked.
#[test]
fn a_quick_look_is_marked_and_has_no_rank() {
    let mut results = vec![
        result("hall/seq-000", "whole", 30.0, 0.9),
        result("hall/seq-000", "other", 29.0, 0.89),
        result("hall/seq-000", "quick", 31.5, 0.91),
    ];
    for result in &mut results[..2] {
        let lpips = summary(0.25, 12);
        result.novel_views.insert("lpips-vgg".to_owned(), lpips);
    }
    results[2].unavailable.push(Unavailable {
        view: "novel".to_owned(),
        metric: "lpips-vgg".to_owned(),
        reason: QUICK_LOOK.to_owned(),
    });
    let place = Place::with(&results);
    place.build();
    let views = place.layout("views.md");
    assert_eq!(views.matches("| 1 of 2 |").count(), 1, "{views}");
    assert_eq!(views.matches("| 2 of 2 |").count(), 1, "{views}");
    let row = views.lines().find(|line| line.starts_with("| quick ‖ "));
    let row = row.unwrap();
    assert!(row.contains("31.500") && row.contains("–"), "{row}");
    assert!(!row.contains("**"), "{row}");
    for file in ["views.md", "views.tex"] {
        let text = place.layout(file);
        assert!(text.contains(QUICK_LOOK), "{file}: {text}");
    }
}

/// The quick look has the best scores of both places.
#[test]
fn a_quick_look_is_best_in_no_output() {
    let mut results = Vec::new();
    for scene in ["hall/seq-000", "park/seq-000"] {
        for (method, psnr) in [("whole", 30.0), ("other", 29.0), ("hasty", 31.5)] {
            let mut result = result(scene, method, psnr, psnr / 40.0);
            if method == "hasty" {
                result.unavailable.push(Unavailable {
                    view: "novel".to_owned(),
                    metric: "lpips-vgg".to_owned(),
                    reason: QUICK_LOOK.to_owned(),
                });
            }
            results.push(result);
        }
    }
    let place = Place::with(&results);
    place.build();
    for (path, text) in texts(&place.request.out) {
        let path = path.display();
        let rows = text.split("<tr").skip(1).filter_map(|row| {
            let (row, _) = row.split_once("</tr>")?;
            row.contains("hasty").then_some(row)
        });
        for line in text.lines().filter(|line| line.contains("hasty")) {
            for mark in ["**", "\\textbf", ",best,"] {
                assert!(!line.contains(mark), "{path}: {line}");
            }
        }
        for row in rows {
            assert!(!row.contains("title=\"best\""), "{path}: {row}");
        }
    }
    for file in ["views.md", "dynamic-scenes.md", "4dgs.md"] {
        let table = place.layout(file);
        let mut rows = table.lines().filter(|line| line.starts_with("| whole"));
        assert!(
            rows.any(|row| row.contains("**30.000**")),
            "{file}: {table}"
        );
    }
    let pages = files(&place.request.out.join("site/methods")).into_iter();
    let pages = pages.map(|(_, bytes)| String::from_utf8(bytes).unwrap());
    let why = "Not ranked: metrics of the protocol were left out for a quick look.";
    assert_eq!(pages.filter(|page| page.contains(why)).count(), 1);
}
