//! Defects of reading: crashes, hangs, memory, misleading results.

use std::fs;

use serde_json::{Value, json};

use super::{
    Attempt, Defect,
    hostile_files::{bomb, processes_with},
};
use crate::support::{METHOD, SEQUENCE, sample, small_run};

pub(super) const DEFECTS: &[Defect] = &[
    Defect {
        id: "D1",
        about: "Matroska with colours that are not members of FFmpeg's enumerations",
        try_again: |attempt| {
            attempt.ends("curate probe colour-trc.mkv", &[0]);
            attempt.ends("curate projection colour-matrix.mkv", &[0]);
            for (name, from) in [
                ("a.mkv", "plain.mkv"),
                ("b.mkv", "colour-trc.mkv"),
                ("c.mp4", "tiny.mp4"),
            ] {
                attempt
                    .hostile
                    .write(&format!("three/{name}"), attempt.hostile.read(from));
            }
            attempt.ends(
                "curate three --criteria none --accept erp --width 32 --out d1",
                &[0],
            );
            for name in ["a", "b", "c"] {
                let analysed = attempt
                    .hostile
                    .path(&format!("d1/videos/{name}/analysis.json"))
                    .is_file();
                attempt.expect(analysed, &format!("{name} was not looked at"));
            }
        },
    },
    Defect {
        id: "D2",
        about: "raw video whose rows run upwards",
        try_again: |attempt| {
            for video in ["bottom-up.avi", "bottom-up-grey.avi"] {
                attempt.ends(&format!("curate projection {video}"), &[0]);
                attempt.ends(&format!("curate boundaries {video}"), &[0]);
            }
        },
    },
    Defect {
        id: "D3",
        about: "a gap of 3e9 s between frames",
        try_again: |attempt| {
            let words = "curate gap.mkv --criteria none --accept erp --fps 5 --out d3";
            attempt.ends_under("ulimit -v 4000000", words, &[0]);
        },
    },
    Defect {
        id: "D9",
        about: "a split that trains on the views that are scored",
        try_again: |attempt| {
            let folder = attempt
                .hostile
                .sequence("cheat", "per-scene/split.json", |split| {
                    let novel = split["novel_views"].as_array().unwrap().clone();
                    split["input_views"].as_array_mut().unwrap().extend(novel);
                });
            let split = format!("{folder}/per-scene/split.json");
            attempt.ends(
                &format!("reconstruct train SCENE --split {split} --out d9"),
                &[2],
            );
            attempt.ends(
                &format!("bench score --scene SCENE --split {split} --run RUN --out d9"),
                &[2],
            );
        },
    },
    Defect {
        id: "D10",
        about: "a playlist named .mp4",
        try_again: |attempt| {
            attempt.ends("curate playlist.mp4 --criteria none --out d10", &[2]);
        },
    },
    Defect {
        id: "D11",
        about: "scenes and models whose frames share a name, lie elsewhere or too far away",
        try_again: |attempt| {
            for (name, image) in [
                ("shared", "frames/000005.png"),
                ("outside", "/etc/passwd"),
                ("above", "../../x.png"),
            ] {
                let folder = attempt.hostile.sequence(name, "scene.json", |scene| {
                    scene["frames"][0]["image"] = json!(image);
                });
                let out = format!("d11-{name}");
                attempt.ends(
                    &format!("curate export {folder} --format nerfstudio --out {out}"),
                    &[2],
                );
                attempt.expect(
                    !attempt.hostile.path(&out).exists(),
                    &format!("{out} is there"),
                );
            }
            attempt.ends("curate export SEQUENCE --format colmap --out model", &[0]);
            let points = "1 1e39 0 0 255 0 0 0\n";
            let found = attempt
                .hostile
                .files_where("model", |file, _| file.ends_with("points3D.txt"));
            attempt
                .hostile
                .write(&format!("model/{}", found[0]), points);
            attempt.ends(
                "curate import model --format colmap --fps 10 --out d11",
                &[2],
            );
        },
    },
    Defect {
        id: "D12",
        about: "an image of 144 million pixels in a few hundred kilobytes",
        try_again: |attempt| {
            let folder = attempt.hostile.copy_of(SEQUENCE, "bomb");
            attempt
                .hostile
                .write("bomb/frames/000000.png", bomb(12_000));
            let scene = format!("{folder}/scene.json");
            let words = format!("reconstruct train {scene} --split SPLIT --out d12");
            attempt.ends_under("ulimit -v 3000000", &words, &[2]);
        },
    },
    Defect {
        id: "D13",
        about: "damaged tables of scores and of signals",
        try_again: |attempt| {
            let score = format!("{METHOD}/score");
            let [a, b] = ["scores-a", "scores-b"].map(|name| attempt.hostile.copy_of(&score, name));
            attempt
                .hostile
                .write("scores-b/frames.csv", "view,frame\nnovel,\u{1b}\n");
            attempt.ends(&format!("bench compare {a} {b}"), &[2]);
            let video = attempt.hostile.copy_of("videos/street", "video");
            // A page that states a negative number of values, for which polars asked for 2^61 bytes.
            let negative = include_bytes!("../../fuzz/kept/signals/negative-page.parquet");
            let whole = attempt.hostile.read("video/signals.parquet");
            attempt.hostile.write("video/signals.parquet", negative);
            attempt.ends(&format!("curate ledger show {video}"), &[0, 2]);
            for number in 0..24 {
                let mut bytes = whole.clone();
                // The footer with sizes and offsets, and pages before it.
                let at = bytes.len() - 9 - number * number % (bytes.len() - 9);
                bytes[at] ^= 0xff;
                attempt.hostile.write("video/signals.parquet", bytes);
                attempt.ends_under(
                    "ulimit -v 4000000",
                    &format!("curate ledger show {video}"),
                    &[0, 1, 2],
                );
            }
        },
    },
    Defect {
        id: "D14",
        about: "a submission whose links lead round in it",
        try_again: |attempt| {
            let card = "method = \"odgs\"\ntitle = \"O\"\nauthors = [\"A\"]\nlicence = \"MIT\"\nhardware = \"x\"\n";
            let card = attempt.hostile.write("card.toml", card);
            attempt.ends(
                &format!("leaderboard submit DATASET --card {card} --out handed-in"),
                &[0],
            );
            for name in ["a", "b"] {
                let link = attempt
                    .hostile
                    .path(&format!("handed-in/results/0000/{name}"));
                std::os::unix::fs::symlink(".", link).unwrap();
            }
            attempt.ends("leaderboard add handed-in --results d14", &[2]);
        },
    },
    Defect {
        id: "D15",
        about: "programs of others that do not end, or never stop talking",
        try_again: |attempt| {
            let seconds = format!("61.{}", std::process::id());
            let method = format!(
                "id = \"m\"\ntime_limit_seconds = 1\n[render]\n\
                 command = [\"sh\", \"-c\", \"sleep {seconds} & sleep {seconds}; wait\"]\n\
                 [predictions]\nnovel = \"{{work}}/{{frame}}.png\"\n"
            );
            let method = attempt.hostile.write("waits/method.toml", method);
            let words = format!("bench external {method} --scene SCENE --split SPLIT --out d15");
            attempt.ends(&words, &[2]);
            attempt.expect(processes_with(&seconds) == 0, "what it started lives on");
            let dataset = attempt.hostile.copy_of("", "captioned");
            for (name, script) in [("slow", "sleep 25 & wait"), ("loud", "yes")] {
                let program = attempt
                    .hostile
                    .write(name, format!("#!/bin/sh\n{script}\n"));
                let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o755);
                fs::set_permissions(&program, permissions).unwrap();
                let words = format!(
                    "curate annotate {dataset} --caption-command {program} --caption-timeout 1"
                );
                attempt.ends(&words, &[2]);
            }
        },
    },
    Defect {
        id: "D16",
        about: "records of runs and sequences with numbers that make no sense",
        try_again: |attempt| {
            let run = attempt.hostile.word("deformable");
            attempt.ends(
                &format!("reconstruct train SCENE --split SPLIT --method deformable --iterations 1 --out {run}"),
                &[0],
            );
            let poses = one_pose(attempt);
            let record = attempt.hostile.read("deformable/run.json");
            for (key, value) in [
                ("width", 0),
                ("width", u64::from(u32::MAX)),
                ("depth", u64::from(u32::MAX)),
                ("position_octaves", 1 << 40),
            ] {
                attempt.hostile.write("deformable/run.json", &record);
                attempt.hostile.change("deformable/run.json", |record| {
                    set_all(&mut record["configuration"], key, value);
                });
                attempt.ends_under(
                    "ulimit -v 4000000",
                    &format!("reconstruct render {run} --poses {poses} --size 64x32 --out d16"),
                    &[2],
                );
            }
            attempt.ends_under(
                "ulimit -v 4000000",
                &format!("reconstruct render RUN --poses {poses} --size 32768x16384 --out d16"),
                &[1],
            );
            for (name, width) in [("empty-frames", 0), ("huge-frames", u64::from(u32::MAX))] {
                let folder = attempt.hostile.sequence(name, "sequence.json", |record| {
                    set_all(record, "width", width);
                });
                attempt.ends(&format!("curate masks {folder} --method residual"), &[2]);
            }
        },
    },
];

/// Returns poses of one frame.
fn one_pose(attempt: &Attempt<'_>) -> String {
    let text = fs::read(sample("poses.json")).unwrap();
    let mut poses: Value = serde_json::from_slice(&text).unwrap();
    poses.as_object_mut().unwrap().remove("points");
    poses["frames"].as_array_mut().unwrap().truncate(1);
    poses["frames"][0].as_object_mut().unwrap().remove("mask");
    assert!(small_run().out.is_dir());
    attempt.hostile.write("one.json", poses.to_string())
}

/// Sets every numeric entry of this name.
fn set_all(value: &mut Value, key: &str, number: u64) {
    match value {
        Value::Object(entries) => {
            for (name, entry) in entries {
                if name == key && entry.is_number() {
                    *entry = json!(number);
                } else {
                    set_all(entry, key, number);
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| set_all(item, key, number)),
        _ => {}
    }
}
