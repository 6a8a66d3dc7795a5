//! Scoring again: the same files, unchanged inputs, damage.

use super::*;

/// Temporal LPIPS looks at the view before, whatever number of views is in memory.
#[test]
fn memory_changes_no_score() {
    let mut bench = Bench::new();
    with_metrics(
        &bench,
        &["psnr", "ssim", "lpips-vgg", "temporal-lpips", "cube-psnr"],
    );
    let bytes = |bench: &Bench| {
        bench.score().unwrap();
        ["result.json", "frames.csv"].map(|name| fs::read(bench.request.out.join(name)).unwrap())
    };
    let plenty = bytes(&bench);
    bench.request.memory_bytes = 1;
    bench.request.out = bench.at("again");
    assert!(bytes(&bench) == plenty);
}

#[test]
fn unchanged_inputs_are_skipped_and_changed_ones_scored_again() {
    let bench = Bench::new();
    let first = bench.score().unwrap();
    let recorder = Recorder::default();
    assert_eq!(score(&bench.request, &recorder).unwrap(), first);
    assert_eq!(*recorder.steps.lock().unwrap(), 0);
    assert_eq!(
        *recorder.notes.lock().unwrap(),
        ["scoring stripes on stripes/seq-000: skipped, nothing has changed"]
    );
    // A prediction, then the ground truth.
    image(4, 3)
        .write_png(&bench.at("novel/000004.png"))
        .unwrap();
    let second = bench.score().unwrap();
    assert!(second.novel_views["psnr"].mean < first.novel_views["psnr"].mean);
    image(4, 3)
        .write_png(&bench.at("scene/frames/000004.png"))
        .unwrap();
    let third = bench.score().unwrap();
    assert!(third.novel_views["psnr"].mean > second.novel_views["psnr"].mean);
    // A prediction that goes away takes its comparison along.
    fs::remove_file(bench.at("novel/000004.png")).unwrap();
    assert_eq!(bench.score().unwrap().failures.len(), 1);
    assert_eq!(
        store::names_in(&bench.at("out/comparisons")).unwrap(),
        ["novel-000009.png"]
    );
    // A lost output is made again.
    fs::remove_file(bench.at("out/frames.csv")).unwrap();
    bench.score().unwrap();
    assert!(bench.at("out/frames.csv").exists());
}

#[test]
fn files_are_the_same_for_every_number_of_threads() {
    let bytes = |threads: usize| {
        let bench = Bench::new();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| bench.score()).unwrap();
        ["result.json", "frames.csv", "comparisons/novel-000004.png"]
            .map(|name| fs::read(bench.at("out").join(name)).unwrap())
    };
    assert!(bytes(1) == bytes(4));
}

/// Scoring overwrites and removes only its own files.
#[test]
fn files_of_others_in_the_folder_of_scores_stay() {
    let bench = Bench::new();
    let out = bench.at("out");
    fs::create_dir_all(out.join("comparisons")).unwrap();
    for name in ["notes.txt", "comparisons/novel-000007.png"] {
        fs::write(out.join(name), "mine").unwrap();
    }
    fs::write(out.join("frames.csv"), "mine").unwrap();
    let message = bench.refusal();
    assert!(message.contains("frames.csv: is in the way"), "{message}");
    fs::remove_file(out.join("frames.csv")).unwrap();
    bench.score().unwrap();
    for name in ["notes.txt", "comparisons/novel-000007.png"] {
        assert_eq!(fs::read_to_string(out.join(name)).unwrap(), "mine");
    }
}

/// One bit of a table: the size is the same.
#[test]
fn a_flipped_bit_in_the_scores_is_noticed() {
    let bench = Bench::new();
    bench.score().unwrap();
    let table = bench.at("out/frames.csv");
    let good = fs::read(&table).unwrap();
    let mut bad = good.clone();
    bad[good.len() / 2] ^= 1;
    fs::write(&table, &bad).unwrap();
    bench.score().unwrap();
    assert_eq!(fs::read(&table).unwrap(), good);
}
