//! Stages as commands of their own, with the scores of the main job.

use std::{fs, path::Path};

use omnilife_schemas::{
    records::{ResultRecord, Scene},
    store,
};

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

/// Writes a 16-bit image of one value, and a mask of its left half, for every frame.
fn write_truth(depth: &Path, class: &Path, frames: u32) {
    fs::create_dir_all(depth).unwrap();
    fs::create_dir_all(class).unwrap();
    for frame in 0..frames {
        let name = format!("{frame:06}.png");
        let distances = image::ImageBuffer::from_pixel(256, 128, image::Luma([800_u16]));
        distances.save(depth.join(&name)).unwrap();
        let marked = |x: u32, _| image::Luma([if x < 128 { 255_u8 } else { 0 }]);
        let mask = image::GrayImage::from_fn(256, 128, marked);
        mask.save(class.join(&name)).unwrap();
    }
}

#[test]
fn distances_and_classes_are_given_with_the_poses_and_scored() {
    let folder = scratch();
    let out = folder.path().join("dataset");
    let build = "curate build @ --out @ --criteria none --max-frames 10 --width 64";
    stage(build, &[&sample("street.mp4"), &out]).succeeded();
    let sequence = out.join(SEQUENCE);
    let [depth, human] = ["depth", "human"].map(|name| folder.path().join(name));
    write_truth(&depth, &human, 9);
    let class = format!("human={}", human.display());
    let pose = |depth: &Path, class: &str| {
        let words = "curate poses @ --poses @ --depth @ --depth-unit 0.0025 --class @";
        let paths = [&sequence, &sample("poses.json"), depth, Path::new(class)];
        stage(words, &paths)
    };
    let message = pose(&depth, &class).failed_quietly(2).to_owned();
    assert!(message.contains("images for 9 of 10 frames"), "{message}");
    write_truth(&depth, &human, 10);
    pose(&depth, &class).succeeded();
    let again = pose(&depth, &class).succeeded();
    assert!(again.stderr.contains("unchanged"), "{}", again.stderr);
    // The sequence's own files are not a source: they would be replaced by themselves.
    let message = pose(&sequence.join("depth"), &class)
        .failed_quietly(2)
        .to_owned();
    assert!(message.contains("keep it elsewhere"), "{message}");
    pose(&depth, &class).succeeded();

    let scene: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
    let frame = &scene.frames[9];
    assert_eq!(frame.depth.as_ref().unwrap().unit, 0.0025);
    let own = image::open(sequence.join(&frame.depth.as_ref().unwrap().file)).unwrap();
    assert_eq!(
        (own.width(), own.into_luma16().get_pixel(63, 31).0),
        (64, [800])
    );
    let mask = image::open(sequence.join(&frame.classes["human"])).unwrap();
    assert_eq!(
        mask.into_luma8()
            .pixels()
            .filter(|pixel| pixel.0[0] > 0)
            .count(),
        32 * 32
    );

    let [split, run, score] = ["split.json", "run", "score"].map(|name| folder.path().join(name));
    let scene = sequence.join("scene.json");
    stage("bench split @ --out @", &[&scene, &split]).succeeded();
    let train = "reconstruct train @ --split @ --out @ --method nearest-input";
    stage(train, &[&scene, &split, &run]).succeeded();
    stage(
        "bench score --scene @ --split @ --run @ --out @",
        &[&scene, &split, &run.join("run.json"), &score],
    )
    .succeeded();
    let result: ResultRecord = store::read_record(&score.join("result.json")).unwrap();
    assert!(
        result.novel_views.contains_key("psnr-human"),
        "{:?}",
        result.unavailable
    );
    let depth = result
        .unavailable
        .iter()
        .find(|one| one.metric == "depth-abs-rel");
    assert!(depth.is_some_and(|one| one.reason.contains("no depth was predicted")));
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
    assert!(built.stdout.contains("1 sequence"), "{}", built.stdout);

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
        stages: Vec::new(),
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
fn predictions_of_other_programs_are_scored_from_plain_folders() {
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
    );
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
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
