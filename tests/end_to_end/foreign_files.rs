//! Foreign files in folders of commands: all of them are kept.

use std::{fs, os::unix::fs::symlink};

use crate::{
    support::{METHOD, SEQUENCE, copy_of_small_run, files, omnilife, sample, scratch, small_run},
    writing_commands::{Inputs, WritingCommand, copy},
};

/// Files that are put into every folder.
const FOREIGN: &[&str] = &["thesis.tex", "archive/notes.txt"];
/// Files that are put there too the second time: under the folders that commands make.
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

/// Runs a command among foreign files; returns the fault, if any.
fn walk(command: &WritingCommand, inputs: &Inputs, in_the_way: &[&str]) -> Option<String> {
    let folder = scratch();
    let (out, outside) = (folder.path().join("out"), folder.path().join("outside.txt"));
    fs::create_dir(&out).unwrap();
    if let Some(from) = &command.copy_of {
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
    let ended = omnilife(command.arguments(inputs, &out));
    let lines = ended.stderr.lines().count();
    let is_expected = match ended.code {
        Some(0) => command.code_among_foreign_files == 0 || !in_the_way.is_empty(),
        Some(2) => lines == 1 && (command.code_among_foreign_files == 2 || !in_the_way.is_empty()),
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
            command.words, ended.code, ended.stdout, ended.stderr
        )
    })
}

#[test]
fn every_command_leaves_foreign_files_alone() {
    let inputs = Inputs::prepare();
    let mut wrong = Vec::new();
    for command in inputs.commands() {
        for in_the_way in [&[], IN_THE_WAY] {
            wrong.extend(walk(&command, inputs, in_the_way));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A finished folder belongs to the program only while it is unchanged.
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

/// The dataset's record is malformed: the file has to be found before anything is curated.
#[test]
fn a_file_in_the_way_of_the_last_step_is_refused_before_videos_are_curated() {
    let video = sample("street.mp4");
    for (command, name) in [
        ("curate", "index.html"),
        ("curate", "README.md"),
        ("run", "index.html"),
    ] {
        let folder = scratch();
        let (record, mine) = (folder.path().join("dataset.json"), folder.path().join(name));
        fs::write(&record, "{}").unwrap();
        fs::write(&mine, "mine").unwrap();
        let out = folder.path().to_str().unwrap();
        let ended = omnilife(["--quiet", command, video.to_str().unwrap(), "--out", out]);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains(&format!("{name}: is in the way")),
            "{message}"
        );
        assert_eq!(fs::read_to_string(mine).unwrap(), "mine");
        assert_eq!(fs::read_to_string(record).unwrap(), "{}");
    }
}

/// Interpolation leaves no page and no checkpoint, and removes those of an earlier training.
#[test]
fn interpolation_removes_no_file_that_a_training_would_have_left() {
    let sequence = small_run().out.join(SEQUENCE);
    let scene = sequence.join("scene.json");
    let split = sequence.join("per-scene/split.json");
    for name in ["progress.html", "trace.csv", "lift.json", "checkpoint.bin"] {
        let folder = scratch();
        let mine = folder.path().join(name);
        fs::write(&mine, "mine").unwrap();
        let mut arguments = vec!["--quiet".as_ref(), "reconstruct".as_ref(), "train".as_ref()];
        arguments.extend([scene.as_os_str(), "--split".as_ref(), split.as_os_str()]);
        arguments.extend(["--method", "cross-fade"].map(std::ffi::OsStr::new));
        arguments.extend(["--out".as_ref(), folder.path().as_os_str()]);
        let ended = omnilife(arguments);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains(&format!("{name}: is in the way")),
            "{message}"
        );
        assert_eq!(fs::read_to_string(mine).unwrap(), "mine");
    }
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
