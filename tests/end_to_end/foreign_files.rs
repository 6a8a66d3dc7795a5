//! Whatever a user keeps in a folder that a command writes into is there afterwards.

use std::{
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
};

use crate::support::{
    METHOD, SEQUENCE, SMALL, copy_of_small_run, files, omnilife, sample, scratch, small_run,
};

/// What is put into every folder.
const FOREIGN: &[&str] = &["thesis.tex", "archive/notes.txt"];
/// What is put there too the second time: under the folders that commands make.
const IN_THE_WAY: &[&str] = &[
    "classes/human/mine.png",
    "comparisons/mine.png",
    "depth/000000.png",
    "dynamic-masks/mine.png",
    "frames/mine.txt",
    "images/mine.png",
    "leaderboard/mine.txt",
    "logs/mine.log",
    "masks/mine.png",
    "predictions/novel/mine.txt",
    "scenes/mine.txt",
    "site/mine.html",
    "slices/mine.mp4",
    "statistics/mine.csv",
    "tables/mine.md",
    "videos/mine.txt",
    "work/mine.txt",
];

/// A command with an output folder: its words, where `OUT` stands for the folder.
struct Row {
    words: Vec<String>,
    /// Where the folder begins as a copy of this one.
    copy_of: Option<PathBuf>,
    /// The exit code among [`FOREIGN`] files.
    code: i32,
}

fn row(words: &str, code: i32) -> Row {
    let run = small_run().out.join(METHOD).join("run");
    let method = small_run().out.join(METHOD);
    let sequence = small_run().out.join(SEQUENCE);
    let places = [
        ("DATASET", small_run().out.clone()),
        ("SEQUENCE", sequence.clone()),
        ("SCENE", sequence.join("scene.json")),
        ("SPLIT", sequence.join("per-scene/split.json")),
        ("METHOD", method),
        ("RUN", run),
        ("VIDEO", sample("street.mp4")),
        ("POSES", sample("poses.json")),
    ];
    let fill = |word: &str| {
        let (name, rest) = word.split_once('/').unwrap_or((word, ""));
        match places.iter().find(|(place, _)| *place == name) {
            Some((_, path)) if rest.is_empty() => path.to_str().unwrap().to_owned(),
            Some((_, path)) => path.join(rest).to_str().unwrap().to_owned(),
            None => word.to_owned(),
        }
    };
    Row {
        words: words.split_whitespace().map(fill).collect(),
        copy_of: None,
        code,
    }
}

fn in_place(folder: &str, words: &str) -> Row {
    Row {
        copy_of: Some(small_run().out.join(folder)),
        ..row(words, 0)
    }
}

/// Every command that writes into a folder. `extra` holds what some of them read.
fn commands(extra: &Path) -> Vec<Row> {
    let extra = extra.display();
    let small = SMALL.join(" ");
    vec![
        // A dataset is made in a folder of its own.
        row(&format!("run VIDEO --poses POSES {small} --out OUT"), 2),
        row("curate VIDEO --criteria none --width 64 --out OUT", 2),
        row(
            "curate video VIDEO --criteria none --width 64 --folder OUT",
            2,
        ),
        row("curate export SEQUENCE --format colmap --out OUT", 2),
        row(
            &format!("curate import {extra}/colmap --format colmap --out OUT"),
            2,
        ),
        row(
            &format!("leaderboard submit DATASET --card {extra}/card.toml --out OUT"),
            2,
        ),
        in_place(
            "",
            &format!("run VIDEO --poses POSES {small} --out OUT --iterations 20"),
        ),
        row("curate select DATASET --count 1 --out OUT", 0),
        in_place("", "curate publish OUT"),
        in_place("", "curate annotate OUT"),
        in_place(SEQUENCE, "curate poses OUT --poses POSES"),
        in_place(SEQUENCE, "curate poses OUT --poses MOVED"),
        in_place(SEQUENCE, "curate masks OUT --from OUT/masks"),
        row("curate slice VIDEO --end 0.5 --out OUT/slice.mp4", 0),
        row("curate boundaries VIDEO --signals OUT/signals.parquet", 0),
        row("bench split SCENE --out OUT/split.json", 0),
        row(
            "bench score --scene SCENE --split SPLIT --run RUN/run.json --out OUT",
            0,
        ),
        row(
            "bench score --scene SCENE --split SPLIT --novel-views RUN/predictions/novel --method m --out OUT",
            0,
        ),
        row(
            &format!("bench external {extra}/method.toml --scene SCENE --split SPLIT --out OUT"),
            0,
        ),
        row(
            "bench failed m --scene SCENE --split SPLIT --reason no --out OUT",
            0,
        ),
        row(&format!("bench curve {extra}/traced-score --out OUT"), 0),
        row("bench adapter pvg --out OUT", 0),
        row(
            "bench run SCENE --methods nearest-input,cross-fade --protocols per-scene --out OUT",
            0,
        ),
        row(
            "bench ablate SCENE --method periodic --plan full --iterations 3 --out OUT",
            0,
        ),
        row(
            "reconstruct train SCENE --split SPLIT --iterations 5 --out OUT",
            0,
        ),
        row(
            "reconstruct train SCENE --split SPLIT --method cross-fade --out OUT",
            0,
        ),
        row(
            "reconstruct render RUN --poses SCENE --size 32x16 --out OUT",
            0,
        ),
        row("reconstruct export RUN --out OUT", 0),
        row(&format!("reconstruct atlas {extra}/nag --out OUT"), 0),
        row(
            &format!("reconstruct edit {extra}/nag --script {extra}/edit.toml --out OUT"),
            0,
        ),
        row("leaderboard build DATASET --out OUT", 0),
        row(
            &format!("leaderboard add {extra}/submission --results OUT"),
            0,
        ),
        row("sweep plan curate VIDEO --dataset OUT/dataset --out OUT", 0),
        row(
            "sweep plan bench SCENE --methods odgs --results OUT/results --out OUT",
            0,
        ),
    ]
}

/// What several commands read.
fn prepare(extra: &Path) {
    fs::write(
        extra.join("method.toml"),
        "id = \"m\"\n[render]\ncommand = [\"true\"]\n\
         [predictions]\nnovel = \"{work}/{frame:06}.png\"\n",
    )
    .unwrap();
    fs::write(extra.join("edit.toml"), "edit = []\n").unwrap();
    fs::write(
        extra.join("card.toml"),
        "method = \"odgs\"\ntitle = \"ODGS\"\nauthors = [\"A\"]\nlicence = \"MIT\"\nhardware = \"x\"\n",
    )
    .unwrap();
    let at = |name: &str| extra.join(name).to_str().unwrap().to_owned();
    for words in [
        row(
            &format!(
                "reconstruct train SCENE --split SPLIT --iterations 10 --trace 5 --out {}",
                at("traced")
            ),
            0,
        ),
        row(
            &format!(
                "bench score --scene SCENE --split SPLIT --run {}/run.json --out {}",
                at("traced"),
                at("traced-score")
            ),
            0,
        ),
        row(
            &format!(
                "reconstruct train SCENE --split SPLIT --method nag --iterations 2 --set rays=64 --out {}",
                at("nag")
            ),
            0,
        ),
        row(
            &format!(
                "curate export SEQUENCE --format colmap --out {}",
                at("colmap")
            ),
            0,
        ),
        row(
            &format!(
                "leaderboard submit DATASET --card {} --out {}",
                at("card.toml"),
                at("submission")
            ),
            0,
        ),
    ] {
        omnilife(&words.words).succeeded();
    }
    // Poses of the sample a step further, without masks or points.
    let text = fs::read_to_string(sample("poses.json")).unwrap();
    let mut poses: serde_json::Value = serde_json::from_str(&text).unwrap();
    poses.as_object_mut().unwrap().remove("points");
    for frame in poses["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("mask");
    }
    fs::write(at("moved.json"), poses.to_string()).unwrap();
}

fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let target = to.join(&file);
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::copy(from.join(&file), target).unwrap();
    }
}

/// Runs a command among foreign files; returns what is wrong.
fn walk(row: &Row, extra: &Path, in_the_way: &[&str]) -> Option<String> {
    let folder = scratch();
    let (out, outside) = (folder.path().join("out"), folder.path().join("outside.txt"));
    fs::create_dir(&out).unwrap();
    if let Some(from) = &row.copy_of {
        copy(from, &out);
    }
    fs::write(&outside, "outside").unwrap();
    symlink(&outside, out.join("link.txt")).unwrap();
    let foreign: Vec<&&str> = FOREIGN
        .iter()
        .chain(in_the_way)
        .filter(|file| !out.join(file).exists())
        .collect();
    for file in &foreign {
        let path = out.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("my {file}")).unwrap();
    }
    let moved = extra.join("moved.json");
    let words = row.words.iter().map(|word| match word.as_str() {
        "MOVED" => moved.to_str().unwrap().to_owned(),
        "OUT" => out.to_str().unwrap().to_owned(),
        word => word.strip_prefix("OUT/").map_or_else(
            || word.to_owned(),
            |rest| out.join(rest).to_str().unwrap().to_owned(),
        ),
    });
    let ended = omnilife(std::iter::once("--quiet".to_owned()).chain(words));
    let lines = ended.stderr.lines().count();
    let is_expected = match ended.code {
        Some(0) => row.code == 0 || !in_the_way.is_empty(),
        Some(2) => lines == 1 && (row.code == 2 || !in_the_way.is_empty()),
        _ => false,
    };
    let lost: Vec<_> = foreign
        .iter()
        .filter(|file| fs::read_to_string(out.join(file)).ok() != Some(format!("my {file}")))
        .collect();
    let is_linked = out.join("link.txt").is_symlink()
        && fs::read_to_string(&outside).is_ok_and(|text| text == "outside");
    let locked = out.join(".omnilife.lock").exists();
    (!is_expected || !lost.is_empty() || !is_linked || locked).then(|| {
        format!(
            "{:?}: exit {:?}, lost {lost:?}, link kept {is_linked}, lock left {locked}: {}{}",
            row.words, ended.code, ended.stdout, ended.stderr
        )
    })
}

#[test]
fn every_command_leaves_foreign_files_alone() {
    let extra = scratch();
    prepare(extra.path());
    let mut wrong = Vec::new();
    for row in commands(extra.path()) {
        for in_the_way in [&[], IN_THE_WAY] {
            wrong.extend(walk(&row, extra.path(), in_the_way));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A finished folder is the program's only where nobody has changed it.
#[test]
fn a_changed_card_of_a_dataset_is_not_overwritten() {
    let folder = copy_of_small_run();
    let publish = || {
        let out = folder.path().to_str().unwrap();
        omnilife(["--quiet", "curate", "publish", out])
    };
    publish().succeeded();
    publish().succeeded();
    let card = folder.path().join("README.md");
    fs::write(&card, "my own words").unwrap();
    let ended = publish();
    assert!(ended.failed_quietly(2).contains("README.md: is in the way"));
    assert_eq!(fs::read_to_string(card).unwrap(), "my own words");
}

/// Rendered views have the names of frames.
#[test]
fn ground_truth_is_not_rendered_over() {
    let folder = copy_of_small_run();
    let frames = folder.path().join(SEQUENCE).join("frames");
    let before = fs::read(frames.join("000004.png")).unwrap();
    let scene = folder.path().join(SEQUENCE).join("scene.json");
    let run = folder.path().join(METHOD).join("run");
    let mut arguments = vec![
        "--quiet".as_ref(),
        "reconstruct".as_ref(),
        "render".as_ref(),
    ];
    arguments.extend([run.as_os_str(), "--poses".as_ref(), scene.as_os_str()]);
    arguments.extend(["--out".as_ref(), frames.as_os_str()]);
    let ended = omnilife(arguments);
    assert!(ended.failed_quietly(2).contains("is in the way"));
    assert_eq!(fs::read(frames.join("000004.png")).unwrap(), before);
    assert_eq!(files(&frames).len(), 10);
}
