//! Main job on the sample (`omnilife run`): its output and files, and the work that it does not repeat.

use std::{fs, path::Path, time::Instant};

use omnilife_bench::curve::{Clock, Region, read_run};
use omnilife_schemas::{
    records::{Dataset, RunRecord, Scene, Sequence, Split, VideoStatus},
    store,
};

use crate::support::{
    INPUT_VIEWS, METHOD, NOVEL_VIEWS, SEQUENCE, SMALL, SMALL_SIZE, assert_all_whole,
    copy_of_small_run, files, read_image, result, run, sample, small_run,
};

/// Returns the cells of the only row of the only table.
fn row(markdown: &str) -> Vec<(String, String)> {
    let cells = |line: &str| -> Vec<String> {
        let inner = line.trim().trim_matches('|');
        inner
            .split('|')
            .map(|cell| cell.trim().to_owned())
            .collect()
    };
    let rows: Vec<&str> = markdown
        .lines()
        .filter(|line| line.starts_with('|'))
        .collect();
    assert_eq!(rows.len(), 3, "head, rule and one row: {markdown}");
    cells(rows[0]).into_iter().zip(cells(rows[2])).collect()
}

fn cell<'a>(row: &'a [(String, String)], title: &str) -> &'a str {
    let found = row.iter().find(|(head, _)| head.starts_with(title));
    &found
        .unwrap_or_else(|| panic!("no column {title}: {row:?}"))
        .1
}

#[test]
fn the_table_says_what_the_records_say() {
    let stdout = &small_run().ended.stdout;
    let result = result(&small_run().out);
    let row = row(stdout);
    assert_eq!(cell(&row, "Scene"), "street/seq-000");
    assert_eq!(cell(&row, "Method"), "odgs");
    for (title, scores, metric, decimals) in [
        ("Input PSNR", &result.input_views, "psnr", 3),
        ("Input SSIM", &result.input_views, "ssim", 4),
        ("Novel PSNR", &result.novel_views, "psnr", 3),
        ("Novel SSIM", &result.novel_views, "ssim", 4),
    ] {
        let mean = scores[metric].mean;
        assert_eq!(cell(&row, title), format!("{mean:.decimals$}"), "{title}");
    }
    assert_eq!(cell(&row, "Iterations"), "30");
    assert_eq!(cell(&row, "Views"), "8 + 2");
    assert_eq!(cell(&row, "Failures"), "0");
    assert!(stdout.contains(&result.protocol_hash[..12]), "{stdout}");
    let table = fs::read_to_string(small_run().out.join("table.md")).unwrap();
    assert!(stdout.starts_with(&table));
    assert!(stdout.contains("scored  street/seq-000"), "{stdout}");
}

#[test]
fn the_documented_files_are_there_and_no_others() {
    let out = &small_run().out;
    assert_all_whole(out);
    let mut expected: Vec<String> = [
        "attrition.csv",
        "dataset.json",
        "funnel.csv",
        "index.html",
        "outcomes.csv",
        "status.json",
        "table.csv",
        "table.md",
    ]
    .map(str::to_owned)
    .into();
    let mut expect = |folder: &str, names: &[&str]| {
        expected.extend(names.iter().map(|name| format!("{folder}/{name}")));
    };
    expect(
        "videos/street",
        &[
            "analysis.json",
            "boundaries.json",
            "samples.parquet",
            "signals.parquet",
            "signature.parquet",
            "slices.json",
        ],
    );
    expect(".done", &["overview.json", "summary.json"]);
    expect("videos/street/.done", &["analysis.json"]);
    expect(SEQUENCE, &["sequence.json", "scene.json", "points.ply"]);
    expect(
        SEQUENCE,
        &[
            ".done/frames.json",
            ".done/poses.json",
            "per-scene/split.json",
        ],
    );
    let run = format!("{METHOD}/run");
    expect(
        &run,
        &["run.json", "gaussians.ply", "trace.csv", "progress.html"],
    );
    expect(&run, &[".done/reconstruct.json"]);
    let score = format!("{METHOD}/score");
    expect(
        &score,
        &[
            "result.json",
            "scoring.json",
            "frames.csv",
            "curve.csv",
            ".done/score.json",
        ],
    );
    for frame in 0..10 {
        expect(SEQUENCE, &[&format!("frames/{frame:06}.png")]);
        expect(SEQUENCE, &[&format!("masks/{frame:06}.png")]);
    }
    let curve = read_run(&out.join(&score), Clock::Wall, Region::Whole).unwrap();
    let rows: Vec<u64> = curve.rows.iter().map(|row| row.iteration).collect();
    assert_eq!((rows[0], rows.last()), (0, Some(&30)));
    assert!(rows.is_sorted_by(|one, next| one < next), "{rows:?}");
    for frame in INPUT_VIEWS {
        expect(&run, &[&format!("predictions/input/{frame:06}.png")]);
    }
    for frame in NOVEL_VIEWS {
        expect(&run, &[&format!("predictions/novel/{frame:06}.png")]);
        expect(&score, &[&format!("comparisons/novel-{frame:06}.png")]);
        // The views of the last row of the trace are the predictions.
        for row in curve.rows.iter().rev().skip(1) {
            expect(
                &run,
                &[&format!("trace/{:06}/{frame:06}.png", row.iteration)],
            );
        }
    }
    expected.sort();
    // The leaderboard chooses the names of the site's pages.
    let (site, found): (Vec<String>, Vec<String>) = files(out)
        .into_iter()
        .partition(|file| file.starts_with("leaderboard/"));
    assert!(site.contains(&"leaderboard/site/index.html".to_owned()));
    assert_eq!(found, expected);
}

#[test]
fn the_records_agree_with_each_other() {
    let out = &small_run().out;
    let dataset: Dataset = store::read_record(&out.join("dataset.json")).unwrap();
    let sequences = [SEQUENCE.to_owned()].into();
    assert_eq!(dataset.videos.len(), 1);
    assert_eq!(dataset.videos[0].status, VideoStatus::Curated { sequences });

    let folder = out.join(SEQUENCE);
    let sequence: Sequence = store::read_record(&folder.join("sequence.json")).unwrap();
    assert_eq!(dataset.videos[0].sha256, Some(sequence.source.sha256));
    assert_eq!((sequence.frames.width, sequence.frames.height), SMALL_SIZE);
    assert!(!sequence.admission.enforced, "run enforces no criteria");

    let scene: Scene = store::read_record(&folder.join("scene.json")).unwrap();
    assert_eq!(scene.frames.len(), sequence.frames.entries.len());
    assert!(scene.frames.iter().all(|frame| frame.pose.is_some()));
    let split: Split = store::read_record(&folder.join("per-scene/split.json")).unwrap();
    assert_eq!(split.input_views, INPUT_VIEWS);
    assert_eq!(split.novel_views, NOVEL_VIEWS);

    let record: RunRecord = store::read_record(&out.join(METHOD).join("run/run.json")).unwrap();
    let result = result(out);
    assert_eq!(record.iterations, 30);
    assert_eq!(result.iterations, Some(30));
    assert_eq!(result.primitives, Some(record.primitives));
    for hash in [record.protocol_hash, result.protocol_hash] {
        assert_eq!(hash, split.protocol_hash);
    }
    assert_eq!(result.failures, []);
}

#[test]
fn the_curve_ends_with_the_means_of_the_novel_views() {
    let out = &small_run().out;
    let curve = read_run(&out.join(METHOD).join("score"), Clock::Wall, Region::Whole).unwrap();
    let (last, result) = (curve.rows.last().unwrap(), result(out));
    assert_eq!(last.iteration, 30);
    assert_eq!(last.psnr_db, result.novel_views["psnr"].mean);
    assert_eq!(last.ssim, Some(result.novel_views["ssim"].mean));
    assert!(last.psnr_db > curve.rows[0].psnr_db);
}

#[test]
fn comparisons_show_prediction_and_truth_side_by_side() {
    let out = &small_run().out;
    let (width, height) = SMALL_SIZE;
    for frame in NOVEL_VIEWS {
        let name = format!("{frame:06}.png");
        let both = read_image(&out.join(format!("{METHOD}/score/comparisons/novel-{name}")));
        let predicted = read_image(&out.join(format!("{METHOD}/run/predictions/novel/{name}")));
        let truth = read_image(&out.join(format!("{SEQUENCE}/frames/{name}")));
        let separator = both.width() - 2 * width;
        assert!((1..=16).contains(&separator), "{separator}");
        for (x, y, pixel) in predicted.enumerate_pixels() {
            assert_eq!(both.get_pixel(x, y), pixel);
            let right = both.get_pixel(width + separator + x, y);
            assert_eq!(right, truth.get_pixel(x, y));
        }
        assert_eq!(both.height(), height);
    }
}

/// Returns the lines of stderr that report a skipped stage.
fn skipped(stderr: &str) -> Vec<&str> {
    let stages = [
        "analysis unchanged",
        "sequence unchanged",
        "poses unchanged",
        "reconstruct ",
        "scoring ",
    ];
    stages
        .into_iter()
        .filter(|stage| {
            stderr
                .lines()
                .any(|line| line.contains(stage) && line.contains("skipped"))
        })
        .map(str::trim)
        .collect()
}

const CURATION: [&str; 3] = [
    "analysis unchanged",
    "sequence unchanged",
    "poses unchanged",
];

fn again(out: &Path, further: &[&str]) -> crate::support::Ended {
    let arguments: Vec<&str> = SMALL.iter().chain(further).copied().collect();
    run(&sample("street.mp4"), out, &arguments).succeeded()
}

#[test]
fn a_second_run_skips_every_stage() {
    let copy = copy_of_small_run();
    let begun = Instant::now();
    let ended = again(copy.path(), &[]);
    let seconds = begun.elapsed().as_secs_f64();
    assert_eq!(skipped(&ended.stderr).len(), 5, "{}", ended.stderr);
    assert!(!ended.stderr.contains("training"), "{}", ended.stderr);
    let table = |out: &Path| fs::read(out.join("table.md")).unwrap();
    assert_eq!(table(copy.path()), table(&small_run().out));
    assert_eq!(files(copy.path()), files(&small_run().out));
    assert!(seconds < 10.0, "took {seconds:.1} s");
}

#[test]
fn other_iterations_redo_reconstruction_and_scores_only() {
    let copy = copy_of_small_run();
    let iterations = [&SMALL[..4], &["--iterations", "20"]].concat();
    let ended = run(&sample("street.mp4"), copy.path(), &iterations).succeeded();
    assert_eq!(skipped(&ended.stderr), CURATION, "{}", ended.stderr);
    let (before, after) = (result(&small_run().out), result(copy.path()));
    assert_eq!(after.iterations, Some(20));
    assert_ne!(before.novel_views, after.novel_views);
    assert_eq!(cell(&row(&ended.stdout), "Iterations"), "20");
    assert_all_whole(copy.path());
}

#[test]
fn a_lost_or_cut_prediction_is_made_again() {
    let copy = copy_of_small_run();
    let file = |name: &str| copy.path().join(METHOD).join("run/predictions").join(name);
    let (lost, cut) = (file("novel/000004.png"), file("input/000000.png"));
    fs::remove_file(&lost).unwrap();
    let bytes = fs::read(&cut).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let ended = again(copy.path(), &[]);
    assert_eq!(&skipped(&ended.stderr)[..3], CURATION, "{}", ended.stderr);
    assert!(ended.stderr.contains("training"), "{}", ended.stderr);
    assert_all_whole(copy.path());
    // The same seed on the same input: the same images, hence the same scores.
    let (before, after) = (result(&small_run().out), result(copy.path()));
    assert_eq!(before.novel_views, after.novel_views);
    assert_eq!(before.input_views, after.input_views);
}

#[test]
fn a_lost_comparison_is_made_without_training() {
    let copy = copy_of_small_run();
    let lost = format!("{METHOD}/score/comparisons/novel-000009.png");
    fs::remove_file(copy.path().join(&lost)).unwrap();
    let ended = again(copy.path(), &[]);
    assert!(!ended.stderr.contains("training"), "{}", ended.stderr);
    assert!(copy.path().join(lost).is_file());
}
