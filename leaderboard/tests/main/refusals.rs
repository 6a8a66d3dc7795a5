//! Results that no table is made of.
use std::{collections::BTreeMap, fs, path::PathBuf};

use crate::{
    leaderboard::{Place, study},
    support::{result, summary, write},
};
use omnilife_leaderboard::{build, build_leaderboard};
use omnilife_schemas::{
    Classified, ErrorKind,
    frame_scores::{FrameRow, FrameScores},
    records::ResultRecord,
};

fn refusal(change: impl Fn(&mut ResultRecord)) -> String {
    let mut results = study();
    change(&mut results[3]);
    let results: Vec<(PathBuf, ResultRecord)> = results
        .into_iter()
        .enumerate()
        .map(|(number, result)| (PathBuf::from(format!("{number}/result.json")), result))
        .collect();
    let out = tempfile::tempdir().unwrap();
    let error = build(&results, out.path()).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    let message = error.to_string();
    assert!(
        message.starts_with("3/result.json: ") && !message.contains('\n'),
        "{message}"
    );
    message
}

#[test]
fn impossible_numbers_are_refused() {
    for (value, printed) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        let message = refusal(|result| {
            result
                .novel_views
                .insert("psnr".to_owned(), summary(value, 12));
        });
        assert!(
            message.contains(&format!("psnr of the novel views is {printed}")),
            "{message}"
        );
    }
    let message = refusal(|result| result.training_seconds = Some(-1.0));
    assert!(
        message.contains("the training time is -1 seconds"),
        "{message}"
    );
    let message = refusal(|result| result.rendering_seconds = Some(f64::NAN));
    assert!(
        message.contains("the rendering time is NaN seconds"),
        "{message}"
    );
    let message = refusal(|result| {
        result
            .novel_views
            .insert("psnr".to_owned(), summary(20.0, 0));
    });
    assert!(message.contains("is a mean of no views"), "{message}");
    for (name, printed) in [("odgs ", "\"odgs \""), ("od\ngs", "\"od\\ngs\"")] {
        let message = refusal(|result| result.method = name.to_owned());
        assert!(
            message.contains("without spaces around it") && message.ends_with(printed),
            "{message}"
        );
    }
    let message = refusal(|result| result.method = " ".to_owned());
    assert!(message.contains("the method has no name"), "{message}");
}

/// A record or a table that was edited by hand.
#[test]
fn means_that_are_not_those_of_their_views_are_refused() {
    let place = Place::with(&[]);
    let scored = ResultRecord {
        input_views: BTreeMap::new(),
        novel_views: [("psnr".to_owned(), summary(20.0, 2))].into(),
        ..result("park", "mine", 20.0, 0.9)
    };
    let folder = write(&place.request.results, &scored);
    let table = |scores: [f64; 2]| {
        let rows = scores
            .into_iter()
            .zip([4, 9])
            .map(|(score, frame)| FrameRow {
                view: "novel".to_owned(),
                frame,
                time_seconds: f64::from(frame),
                distance_to_given: None,
                scores: vec![Some(score)],
            });
        let table = FrameScores {
            metrics: vec!["psnr".to_owned()],
            rows: rows.collect(),
        };
        table.write(&folder.join("frames.csv")).unwrap();
    };
    table([19.0, 21.0]);
    build_leaderboard(&place.request).unwrap();
    table([19.0, 22.0]);
    let message = build_leaderboard(&place.request).unwrap_err().to_string();
    assert!(
        message.contains("psnr of the novel views is 20, its table gives 20.5"),
        "{message}"
    );
}

#[test]
fn a_newer_schema_is_refused_by_name() {
    let place = Place::with(&study());
    let folder = write(&place.request.results, &study()[0]);
    let file = folder.join("result.json");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(
        &file,
        text.replace("omnilife/result/3", "omnilife/result/4"),
    )
    .unwrap();
    let message = build_leaderboard(&place.request).unwrap_err().to_string();
    assert!(
        message.contains("is of schema omnilife/result/4, expected omnilife/result/3"),
        "{message}"
    );
    assert!(!place.request.out.exists(), "nothing is written");
}
