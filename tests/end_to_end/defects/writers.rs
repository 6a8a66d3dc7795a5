//! Defects of writing: lost files of the user, names, leftovers, sweeps.

use std::{
    fs,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use assert_cmd::cargo::cargo_bin;
use omnilife_schemas::store;
use serde_json::json;

use super::{Attempt, Defect};
use crate::support::{METHOD, SEQUENCE, SMALL, files, sample};

pub(super) const DEFECTS: &[Defect] = &[
    Defect {
        id: "D4",
        about: "a list of files in the folder of a leaderboard that names files of the user's",
        try_again: |attempt| {
            let sum = store::sha256_bytes(b"x\n");
            for (number, list) in [
                format!("{sum}  thesis.tex\n"),
                "0  src\n".to_owned(),
                "0  \n".to_owned(),
                "0  link/f\n".to_owned(),
            ]
            .iter()
            .enumerate()
            {
                let out = format!("d4-{number}");
                let kept =
                    ["thesis.tex", "src/main.rs", "files.txt"].map(|file| format!("{out}/{file}"));
                attempt.hostile.write(&kept[0], "x\n");
                attempt.hostile.write(&kept[1], "x\n");
                attempt.hostile.write(&kept[2], list);
                attempt.hostile.write("elsewhere/f", "x\n");
                let link = attempt.hostile.path(&format!("{out}/link"));
                std::os::unix::fs::symlink(attempt.hostile.path("elsewhere"), link).unwrap();
                attempt.ends(&format!("leaderboard build DATASET --out {out}"), &[0]);
                attempt.expect_kept(&kept[0], b"x\n");
                attempt.expect_kept(&kept[1], b"x\n");
                attempt.expect_kept(&kept[2], list.as_bytes());
                attempt.expect_kept("elsewhere/f", b"x\n");
            }
        },
    },
    Defect {
        id: "D5",
        about: "a run of another program into the folder of its sources",
        try_again: |attempt| {
            let method = "id = \"m\"\n[render]\ncommand = [\"true\"]\n[predictions]\nnovel = \"{work}/{frame}.png\"\n";
            let method = attempt.hostile.write("checkout/method.toml", method);
            for folder in ["logs", "work", "predictions"] {
                attempt
                    .hostile
                    .write(&format!("checkout/{folder}/mine"), "mine");
            }
            attempt.ends(
                &format!("bench external {method} --scene SCENE --split SPLIT --out checkout"),
                &[2],
            );
            for folder in ["logs", "work", "predictions"] {
                attempt.expect_kept(&format!("checkout/{folder}/mine"), b"mine");
            }
        },
    },
    Defect {
        id: "D6",
        about: "new poses for a sequence with masks, depth and classes of the user's",
        try_again: |attempt| {
            let folder = attempt.hostile.copy_of(SEQUENCE, "posed");
            store::remove(&attempt.hostile.path("posed/.done")).unwrap();
            store::remove(&attempt.hostile.path("posed/scene.json")).unwrap();
            let mine = [
                "depth/000000.png",
                "classes/human/000000.png",
                "masks/notes.txt",
            ]
            .map(|file| format!("posed/{file}"));
            for file in &mine {
                attempt.hostile.write(file, "mine");
            }
            let text = fs::read(sample("poses.json")).unwrap();
            attempt.hostile.write("unmasked.json", text);
            attempt.hostile.change("unmasked.json", |poses| {
                poses.as_object_mut().unwrap().remove("points");
                for frame in poses["frames"].as_array_mut().unwrap() {
                    frame.as_object_mut().unwrap().remove("mask");
                }
            });
            attempt.ends(
                &format!("curate poses {folder} --poses unmasked.json"),
                &[0, 2],
            );
            for file in &mine {
                attempt.expect_kept(file, b"mine");
            }
        },
    },
    Defect {
        id: "D7",
        about: "a slice over its source, views over the ground truth",
        try_again: |attempt| {
            let video = attempt.hostile.read("tiny.mp4");
            attempt.hostile.write("v.mp4", &video);
            attempt.ends("curate slice v.mp4 --end 0.5 --out v.mp4", &[2]);
            attempt.expect_kept("v.mp4", &video);
            let folder = attempt.hostile.copy_of(SEQUENCE, "truth");
            let frame = attempt.hostile.read("truth/frames/000004.png");
            let (scene, frames) = (format!("{folder}/scene.json"), format!("{folder}/frames"));
            attempt.ends(
                &format!("reconstruct render RUN --poses {scene} --out {frames}"),
                &[2],
            );
            attempt.expect_kept("truth/frames/000004.png", &frame);
        },
    },
    Defect {
        id: "D8",
        about: "a second run into a folder that one writes into",
        try_again: |attempt| {
            let mut first = omnilife(attempt, &curation("d8", "64"));
            let begun = attempt.hostile.path("d8/.omnilife.lock");
            while !begun.exists() && first.try_wait().unwrap().is_none() {
                thread::sleep(Duration::from_millis(5));
            }
            attempt.ends(&curation("d8", "128"), &[2]);
            attempt.expect(first.wait().unwrap().success(), "the first one failed");
        },
    },
    Defect {
        id: "D17",
        about: "job arrays of 2^64 seconds",
        try_again: |attempt| {
            plan(attempt, "d17");
            for option in ["--signal-before", "--minutes"] {
                let words =
                    format!("sweep submit d17 --slurm --dry-run {option} 18446744073709551615");
                attempt.ends(&words, &[2]);
            }
        },
    },
    Defect {
        id: "D18",
        about: "a unit of a sweep whose record cannot be read",
        try_again: |attempt| {
            plan(attempt, "d18");
            attempt.ends("sweep run d18", &[0]);
            let unit = files(&attempt.hostile.path("d18"))
                .into_iter()
                .find(|file| file.ends_with("done.json"));
            attempt.hostile.write(&format!("d18/{}", unit.unwrap()), "");
            attempt.ends("sweep status d18", &[0]);
            attempt.ends("sweep run d18", &[1]);
            attempt.ends("sweep retry d18", &[0]);
            attempt.ends("sweep run d18", &[0]);
        },
    },
    Defect {
        id: "D19",
        about: "looking at a sweep",
        try_again: |attempt| {
            plan(attempt, "d19");
            let before = files(&attempt.hostile.path("d19"));
            attempt.ends("sweep status d19", &[0]);
            let is_same = files(&attempt.hostile.path("d19")) == before;
            attempt.expect(is_same, "it writes");
        },
    },
    Defect {
        id: "D20",
        about: "claims of a sweep with numbers of 4e9, and of the future",
        try_again: |attempt| {
            plan(attempt, "d20");
            for claim in ["claim-4000000000.json", "claim-18446744073709551615.json"] {
                attempt
                    .hostile
                    .write(&format!("d20/units/line-00001/{claim}"), "");
            }
            attempt.ends("sweep run d20", &[0]);
        },
    },
    Defect {
        id: "D21",
        about: "videos named ...mp4, ..mp4, .mp4 and with a line break",
        try_again: |attempt| {
            let video = attempt.hostile.read("tiny.mp4");
            for (number, name) in ["...mp4", "..mp4", ".mp4", "a\nb.mp4"]
                .into_iter()
                .enumerate()
            {
                let (video, out) = (
                    attempt.hostile.write(&format!("names/{name}"), &video),
                    format!("d21-{number}"),
                );
                attempt.ends(
                    &format!("curate {video} --criteria none --accept erp --out {out}"),
                    &[0],
                );
                let stray = [
                    "analysis.json",
                    "seq-000",
                    "videos/analysis.json",
                    "videos/seq-000",
                ];
                let astray = stray
                    .iter()
                    .find(|file| attempt.hostile.path(&format!("{out}/{file}")).exists());
                attempt.expect(
                    astray.is_none(),
                    &format!("{name:?}: {astray:?} is not in its folder"),
                );
                attempt.ends(&format!("curate publish {out}"), &[0]);
                attempt.ends(&format!("curate verify {out}"), &[0]);
            }
        },
    },
    Defect {
        id: "D22",
        about: "names that mean something in Markdown, CSV, LaTeX and HTML",
        try_again: |attempt| {
            let score = format!("{METHOD}/score");
            attempt.hostile.copy_of(&score, "named");
            for name in [
                "![](https://evil.invalid/p.png)",
                "=cmd|' /C calc'!A0",
                "[a] & b_c",
                "* x",
                "<script>alert(1)</script>",
            ] {
                attempt
                    .hostile
                    .change("named/result.json", |record| record["method"] = json!(name));
                store::remove(&attempt.hostile.path("d22")).unwrap();
                attempt.ends("leaderboard build named --out d22", &[0, 2]);
                if !attempt.hostile.path("d22").is_dir() {
                    continue;
                }
                let wrong = attempt.hostile.files_where("d22", |file, text| {
                    let mut lines = text.lines();
                    match file.rsplit('.').next() {
                        Some("md") => text.contains("![](https"),
                        Some("csv") => lines.any(|line| {
                            line.split(',')
                                .any(|cell| cell.trim_start_matches('"').starts_with('='))
                        }),
                        Some("tex") => {
                            lines.any(|line| line.starts_with('[') || line.starts_with('*'))
                        }
                        Some("html") => text.contains("<script>alert"),
                        _ => false,
                    }
                });
                attempt.expect(
                    wrong.is_empty(),
                    &format!("{name} is taken at its word in {wrong:?}"),
                );
            }
        },
    },
    Defect {
        id: "D23",
        about: "control characters in records",
        try_again: |attempt| {
            let poses =
                "{\"schema\": \"omnilife/poses/1\", \"scale\": \"\\u001b[31mX\", \"frames\": []}";
            attempt.hostile.write("coloured.json", poses);
            let folder = attempt.hostile.copy_of(SEQUENCE, "coloured");
            attempt.ends(
                &format!("curate poses {folder} --poses coloured.json"),
                &[2],
            );
        },
    },
    Defect {
        id: "D24",
        about: "what a killed command leaves half-written",
        try_again: |attempt| {
            for milliseconds in [150, 300, 450, 600] {
                let mut killed = omnilife(attempt, &curation("d24", "256"));
                thread::sleep(Duration::from_millis(milliseconds));
                // It may be over already.
                drop(killed.kill());
                killed.wait().unwrap();
            }
            attempt.ends(&curation("d24", "256"), &[0]);
            let left = attempt
                .hostile
                .files_where("d24", |file, _| file.contains(".tmp-"));
            attempt.expect(left.is_empty(), &format!("{left:?} is left"));
        },
    },
    Defect {
        id: "D25",
        about: "mistakes of the user's, by their exit code",
        try_again: |attempt| {
            attempt.hostile.write("plain", "mine");
            let words = "curate tiny.mp4 --criteria none --accept erp --out plain/x";
            attempt.ends(words, &[2]);
            attempt.expect_kept("plain", b"mine");
            attempt.ends(
                "curate export SEQUENCE --format colmap --out model-25",
                &[0],
            );
            store::remove(&attempt.hostile.path("model-25/times.csv")).unwrap();
            attempt.ends(
                "curate import model-25 --format colmap --fps 1e-308 --out d25",
                &[2],
            );
            let long = format!("{}.mp4", "x".repeat(245));
            attempt
                .hostile
                .write(&long, attempt.hostile.read("tiny.mp4"));
            attempt.ends(
                &format!("curate {long} --criteria none --accept erp --out d25-long"),
                &[0, 2],
            );
            attempt
                .hostile
                .write("twice.json", fs::read(sample("poses.json")).unwrap());
            attempt.hostile.change("twice.json", |poses| {
                poses.as_object_mut().unwrap().remove("points");
                let frames = poses["frames"].as_array_mut().unwrap();
                frames
                    .iter_mut()
                    .for_each(|frame| drop(frame.as_object_mut().unwrap().remove("mask")));
                let mut again = frames[0].clone();
                again["pose"]["centre"][0] = json!(5.0);
                frames.insert(1, again);
            });
            let folder = attempt.hostile.copy_of(SEQUENCE, "twice");
            attempt.ends(&format!("curate poses {folder} --poses twice.json"), &[2]);
            let dataset = attempt.hostile.copy_of("", "tagged");
            attempt.hostile.write("garbage.csv", "garbage\n");
            attempt.ends(
                &format!("curate annotate {dataset} --tags garbage.csv"),
                &[2],
            );
        },
    },
];

fn curation(out: &str, width: &str) -> String {
    let [option, frames] = [SMALL[0], SMALL[1]];
    format!("curate VIDEO --criteria none --width {width} --out {out} {option} {frames}")
}

/// Starts a command in the folder of the attempt.
fn omnilife(attempt: &Attempt<'_>, words: &str) -> std::process::Child {
    Command::new(cargo_bin!("omnilife"))
        .arg("--quiet")
        .args(words.split(' ').map(|word| attempt.filled(word)))
        .current_dir(attempt.hostile.path(""))
        .env("OMNILIFE_DATA", "/nonexistent")
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

/// Plans a sweep of two units that do nothing.
fn plan(attempt: &mut Attempt<'_>, out: &str) {
    let lines = attempt.hostile.write("lines.txt", "true\ntrue\n");
    attempt.ends(&format!("sweep plan commands {lines} --out {out}"), &[0]);
}
