//! The stages as commands of their own come to the scores of the main job.

use std::{fs, path::Path};

use omnilife_schemas::{records::ResultRecord, store};

use crate::support::{
    Ended, METHOD, SEQUENCE, assert_all_whole, omnilife, result, sample, scratch, small_run,
};

/// Runs a command whose words are separated by spaces; paths follow their names.
fn stage(words: &str, paths: &[&Path]) -> Ended {
    let mut paths = paths.iter();
    omnilife(words.split(' ').map(|word| match word {
        "@" => paths.next().unwrap().as_os_str().to_owned(),
        word => word.into(),
    }))
}

#[test]
fn stage_by_stage_gives_the_scores_of_the_main_job() {
    let folder = scratch();
    let out = folder.path().join("dataset");
    let built = stage(
        "curate build @ --out @ --criteria none --max-frames 10 --width 128",
        &[&sample("street.mp4"), &out],
    )
    .succeeded();
    assert!(built.stdout.contains("1 sequences"), "{}", built.stdout);

    let sequence = out.join(SEQUENCE);
    let posed = stage(
        "curate poses @ --poses @",
        &[&sequence, &sample("poses.json")],
    )
    .succeeded();
    assert!(
        posed.stdout.contains("10 of 10 frames posed"),
        "{}",
        posed.stdout
    );

    let (scene, split) = (
        sequence.join("scene.json"),
        folder.path().join("split.json"),
    );
    let parted = stage("bench split @ --out @", &[&scene, &split]).succeeded();
    assert!(
        parted.stdout.contains("8 input views, 2 novel views"),
        "{}",
        parted.stdout
    );

    let run = folder.path().join("run");
    stage(
        "reconstruct train @ --split @ --out @ --iterations 30",
        &[&scene, &split, &run],
    )
    .succeeded();

    let score = folder.path().join("score");
    stage(
        "bench score --scene @ --split @ --run @ --out @",
        &[&scene, &split, &run.join("run.json"), &score],
    )
    .succeeded();

    let whole = result(&small_run().out);
    let staged: ResultRecord = store::read_record(&score.join("result.json")).unwrap();
    let timeless = |result: &ResultRecord| ResultRecord {
        training_seconds: None,
        rendering_seconds: None,
        peak_memory_bytes: None,
        ..result.clone()
    };
    assert_eq!(timeless(&staged), timeless(&whole));

    let tables = folder.path().join("tables");
    let built = stage("leaderboard build @ --out @", &[folder.path(), &tables]).succeeded();
    let markdown = fs::read_to_string(tables.join("table.md")).unwrap();
    assert!(built.stdout.starts_with(&markdown));
    assert!(markdown.contains("| street/seq-000 | odgs "), "{markdown}");
    assert_all_whole(folder.path());
}

#[test]
fn anyones_predictions_are_scored_from_plain_folders() {
    let out = &small_run().out;
    let scene = out.join(SEQUENCE).join("scene.json");
    let split = out.join(SEQUENCE).join("per-scene/split.json");
    let predictions = out.join(METHOD).join("run/predictions");
    let folder = scratch();
    let score = folder.path().join("theirs");
    stage(
        "bench score --scene @ --split @ --novel-views @ --input-views @ --out @ --method theirs",
        &[
            &scene,
            &split,
            &predictions.join("novel"),
            &predictions.join("input"),
            &score,
        ],
    )
    .succeeded();
    let theirs: ResultRecord = store::read_record(&score.join("result.json")).unwrap();
    let ours = result(out);
    assert_eq!(theirs.method, "theirs");
    assert_eq!(theirs.novel_views, ours.novel_views);
    assert_eq!(theirs.input_views, ours.input_views);
    assert_eq!(theirs.training_seconds, None);
}

#[test]
fn a_missing_prediction_is_a_row_of_the_result() {
    let out = &small_run().out;
    let scene = out.join(SEQUENCE).join("scene.json");
    let split = out.join(SEQUENCE).join("per-scene/split.json");
    let folder = scratch();
    let predictions = folder.path().join("predictions");
    fs::create_dir(&predictions).unwrap();
    // The ground truth itself, for one of two novel views.
    fs::copy(
        out.join(SEQUENCE).join("frames/000009.png"),
        predictions.join("000009.png"),
    )
    .unwrap();
    let score = folder.path().join("score");
    let ended = stage(
        "bench score --scene @ --split @ --novel-views @ --out @ --method perfect",
        &[&scene, &split, &predictions, &score],
    )
    .succeeded();
    assert!(
        ended
            .stdout
            .contains("failed: novel view 4: 000004.png is missing"),
        "{}",
        ended.stdout
    );
    let result: ResultRecord = store::read_record(&score.join("result.json")).unwrap();
    assert_eq!(result.failures.len(), 1);
    assert_eq!(result.failures[0].frame, 4);
    assert_eq!(result.novel_views["psnr"].views, 1);
    assert!((result.novel_views["psnr"].mean - 100.0).abs() < 1e-9);
    assert!((result.novel_views["ssim"].mean - 1.0).abs() < 1e-9);
}

#[test]
fn curation_enforces_its_criteria_unless_told_otherwise() {
    let folder = scratch();
    let out = folder.path().join("dataset");
    let ended = stage(
        "--quiet curate build @ --out @",
        &[&sample("street.mp4"), &out],
    );
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("street.mp4") && message.contains("resolution"),
        "{message}"
    );
    assert_all_whole(&out);
}
