//! Scores of tracks against those of PyPI `motmetrics` and `trackeval`. Skipped with a printed reason where
//! `scripts/setup --compare` has not installed them.

use std::{collections::BTreeMap, fmt::Write as _, fs, path::Path, process::Command};

use omnilife_bench::tracking::boxes::{LEAST_OVERLAP, TrackBox, score_boxes};
use omnilife_schemas::{store, testing};

/// Numbers of [0, 1) (Knuth's linear congruential generator).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Objects that cross, are missed, are found in vain, change their numbers and come back.
fn clip(seed: u64) -> [Vec<TrackBox>; 2] {
    let mut random = Random(seed);
    let (mut truth, mut found) = (Vec::new(), Vec::new());
    let mut numbers: Vec<u32> = (0..8).map(|id| 100 + id).collect();
    for frame in 0..60_u32 {
        for id in 0..8_u32 {
            let (f, n) = (f64::from(frame), f64::from(id));
            // Far apart across, so that a number never goes to another one by a tie.
            let place = [20.0 + 9.0 * f + 3.0 * n, 60.0 * n + 4.0 * (0.3 * f).sin()];
            if !(3..57).contains(&frame) && id % 3 == 0 {
                continue;
            }
            truth.push(TrackBox {
                frame,
                id,
                box_pixels: [place[0], place[1], 30.0, 18.0],
            });
            if random.next() < 0.15 {
                continue;
            }
            if random.next() < 0.03 {
                numbers[id as usize] += 10;
            }
            let off = [(); 4].map(|()| 8.0 * (random.next() - 0.5));
            found.push(TrackBox {
                frame,
                id: numbers[id as usize],
                box_pixels: [
                    place[0] + off[0],
                    place[1] + off[1],
                    30.0 + off[2],
                    18.0 + off[3],
                ],
            });
        }
        if random.next() < 0.3 {
            found.push(TrackBox {
                frame,
                id: 900 + frame / 7,
                box_pixels: [600.0 * random.next(), 700.0, 20.0, 20.0],
            });
        }
    }
    [truth, found]
}

fn write(boxes: &[TrackBox], file: &Path) {
    let mut text = String::new();
    for one in boxes {
        let [left, top, width, height] = one.box_pixels;
        writeln!(
            text,
            "{},{},{left},{top},{width},{height}",
            one.frame, one.id
        )
        .unwrap();
    }
    fs::write(file, text).unwrap();
}

#[test]
fn scores_are_those_of_motmetrics_and_trackeval() {
    let python = store::data_folder().map(|folder| folder.join("compare/bin/python"));
    let has_both = |python: &Path| {
        let imports = Command::new(python)
            .args(["-c", "import motmetrics, trackeval"])
            .output();
        imports.is_ok_and(|output| output.status.success())
    };
    let Some(python) = python.filter(|python| has_both(python)) else {
        testing::skip("motmetrics and trackeval are not installed (scripts/setup --compare)");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/peers/track_scores.py");
    let folder = tempfile::tempdir().unwrap();
    let [truth_file, found_file] = ["truth.txt", "found.txt"].map(|name| folder.path().join(name));
    for seed in 0..3 {
        let [truth, found] = clip(seed);
        write(&truth, &truth_file);
        write(&found, &found_file);
        let output = Command::new(&python)
            .arg(&script)
            .args([&truth_file, &found_file])
            .arg(LEAST_OVERLAP.to_string())
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let theirs: BTreeMap<String, BTreeMap<String, f64>> =
            serde_json::from_slice(&output.stdout).unwrap();
        let ours = score_boxes(&truth, &found);
        assert!(ours.switches > 3 && ours.misses > 30 && ours.false_positives > 5);
        assert_eq!(theirs.len(), 2);
        for (name, theirs) in theirs {
            for (measure, own) in [
                ("mota", ours.mota),
                ("idf1", ours.idf1),
                ("num_switches", f64::from(ours.switches)),
                ("num_fragmentations", f64::from(ours.fragmentations)),
                ("num_misses", f64::from(ours.misses)),
                ("num_false_positives", f64::from(ours.false_positives)),
            ] {
                let value = theirs[measure];
                assert!(
                    (value - own).abs() < 1e-6,
                    "{name}: {measure} is {value}, ours {own}"
                );
            }
        }
    }
}
