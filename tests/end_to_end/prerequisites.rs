//! Missing prerequisites, reported before the first frame: exit code 2, one line, nothing written.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use assert_cmd::cargo::cargo_bin_cmd;

use crate::support::{
    Ended, SEQUENCE, SMALL, copy_of_small_run, files, omnilife, sample, scratch, small_run,
};

/// Path of an output that does not exist yet.
struct OutputPath {
    folder: tempfile::TempDir,
}

impl OutputPath {
    fn new() -> Self {
        Self { folder: scratch() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// Checks that a command, run without `--quiet`, printed one line and left nothing.
    #[track_caller]
    fn assert_untouched(&self, ended: &Ended, reason: &str) {
        // Work that had started would have reported so in a line of its own.
        let message = ended.failed_quietly(2);
        assert!(message.contains(reason), "{message}");
        assert_eq!(ended.stdout, "");
        assert!(!self.path().exists(), "{:?}", files(&self.path()));
    }
}

/// Runs `omnilife run` on the sample, with reports of its progress.
fn run(out: &Path, further: &[&str]) -> Ended {
    let video = sample("street.mp4");
    let arguments = ["run".as_ref(), video.as_os_str(), "--out".as_ref()];
    let arguments = arguments.into_iter().chain([out.as_os_str()]);
    omnilife(arguments.chain(SMALL.iter().chain(further).map(OsStr::new)))
}

#[test]
fn structure_from_motion() {
    let out = OutputPath::new();
    out.assert_untouched(&run(&out.path(), &[]), "scripts/setup --sfm");
    // Of many videos the good one needs it.
    let videos = out.folder.path().join("videos");
    fs::create_dir(&videos).unwrap();
    fs::write(videos.join("a.mp4"), "").unwrap();
    fs::copy(sample("street.mp4"), videos.join("b.mp4")).unwrap();
    let arguments = ["run".as_ref(), videos.as_os_str(), "--out".as_ref()];
    let ended = omnilife(arguments.into_iter().chain([out.path().as_os_str()]));
    out.assert_untouched(&ended, "scripts/setup --sfm");
}

/// Sequences of an earlier run may exist; the stage that needs the others reports them.
#[test]
fn sequences_of_an_earlier_run_are_left_to_their_stages() {
    let copy = copy_of_small_run();
    let ended = run(copy.path(), &["--quiet"]);
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("scripts/setup --sfm") && message.contains("street/seq-000"),
        "{message}"
    );
}

#[test]
fn poses_that_can_be_read() {
    let out = OutputPath::new();
    let model = out.folder.path().join("model");
    fs::create_dir(&model).unwrap();
    let camera = "1 EQUIRECTANGULAR 128 64 128 64\n";
    fs::write(model.join("cameras.txt"), camera).unwrap();
    fs::write(model.join("images.txt"), "1 1 0 0 0 zero 0 0 1 a.png\n\n").unwrap();
    fs::write(model.join("points3D.txt"), "").unwrap();
    let text = fs::read_to_string(sample("poses.json")).unwrap();
    let write = |name: &str, text: &str| {
        let path = out.folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    };
    // The mask and the points of the sample are not beside the copy.
    let copy = write("copy.json", &text);
    let cut = write("cut.json", &text[..text.len() / 2]);
    for (poses, reason) in [
        (&model, "images.txt"),
        (&cut, "cut.json: "),
        (&copy, "cannot be read"),
        (&sample("README.md"), "README.md: "),
    ] {
        let ended = run(&out.path(), &["--poses", poses.to_str().unwrap()]);
        out.assert_untouched(&ended, reason);
    }
}

#[test]
fn masks_that_are_there() {
    let out = OutputPath::new();
    let (poses, missing) = (sample("poses.json"), out.folder.path().join("missing"));
    let (poses, missing) = (poses.to_str().unwrap(), missing.to_str().unwrap());
    for option in ["--masks", "--ignore-mask"] {
        let ended = run(&out.path(), &["--poses", poses, option, missing]);
        out.assert_untouched(&ended, "missing: does not exist");
    }
}

#[test]
fn weights_of_a_boundary_detector() {
    let out = OutputPath::new();
    let poses = sample("poses.json");
    let poses = ["--poses", poses.to_str().unwrap()];
    let detector = ["--detector", "transnetv2"];
    let ended = run(&out.path(), &[poses, detector].concat());
    out.assert_untouched(&ended, "scripts/setup --models");
    let (video, folder) = (sample("street.mp4"), out.path());
    let mut arguments = vec!["curate", "build", video.to_str().unwrap(), "--out"];
    arguments.push(folder.to_str().unwrap());
    arguments.extend(detector);
    out.assert_untouched(&omnilife(arguments), "scripts/setup --models");
}

/// Without a driver there is no adapter, not even a software one.
#[cfg(target_os = "linux")]
#[test]
fn an_adapter_for_the_backend() {
    let out = OutputPath::new();
    let (video, poses) = (sample("street.mp4"), sample("poses.json"));
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let split = scene.with_file_name("per-scene").join("split.json");
    let run = ["run".as_ref(), video.as_os_str(), "--poses".as_ref()];
    let run = run.into_iter().chain([poses.as_os_str()]);
    let train = ["reconstruct", "train"].map(OsStr::new).into_iter();
    let train = train.chain([scene.as_os_str(), "--split".as_ref(), split.as_os_str()]);
    let bench = ["bench", "run"].map(OsStr::new).into_iter();
    let bench = bench.chain([scene.as_os_str(), "--methods".as_ref(), "odgs".as_ref()]);
    for words in [
        run.collect::<Vec<_>>(),
        train.collect::<Vec<_>>(),
        bench.collect::<Vec<_>>(),
    ] {
        let output = cargo_bin_cmd!("omnilife")
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent")
            .args(&words)
            .args(["--backend", "gpu", "--out"])
            .arg(out.path())
            .output()
            .unwrap();
        let ended = Ended {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        };
        let message = ended.stderr.lines().last().unwrap_or_default();
        assert_eq!(ended.code, Some(2), "{words:?}: {}", ended.stderr);
        assert!(message.contains("there is no GPU"), "{words:?}: {message}");
        assert!(!out.path().exists(), "{words:?}");
    }
}

#[test]
fn a_folder_of_its_own() {
    let folder = scratch();
    fs::write(folder.path().join("diary.txt"), "mine").unwrap();
    let poses = sample("poses.json");
    let ended = run(folder.path(), &["--poses", poses.to_str().unwrap()]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("is not empty"), "{message}");
    // In a dataset too, foreign files stay.
    let copy = copy_of_small_run();
    fs::remove_file(copy.path().join(".done/summary.json")).unwrap();
    let ended = run(copy.path(), &["--poses", poses.to_str().unwrap()]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("outcomes.csv"), "{message}");
}

#[test]
fn what_a_detector_of_vehicles_reads() {
    let out = OutputPath::new();
    let (scene, folder) = (small_run().out.join(SEQUENCE), out.path());
    for (detector, option) in [("command", "--program"), ("files", "--detections")] {
        let arguments = ["curate", "tracks", scene.to_str().unwrap(), "--detector"];
        let arguments = arguments.into_iter().chain([detector, "--out"]);
        let ended = omnilife(arguments.chain([folder.to_str().unwrap()]));
        out.assert_untouched(&ended, option);
    }
}

#[test]
fn tracking_of_the_main_job_is_possible() {
    let out = OutputPath::new();
    let poses = sample("poses.json");
    let poses = ["--poses", poses.to_str().unwrap()];
    let missing = out.folder.path().join("missing.toml");
    let missing = missing.to_str().unwrap();
    let graph = ["--method", "object-graph"];
    let of_program = ["--vehicle-detector", "command", "--program", missing];
    for (words, reason) in [
        (
            vec!["--association", "deepsort"],
            "--association is for methods that take tracks of vehicles",
        ),
        (
            [&graph[..], &["--vehicle-detector", "radar"]].concat(),
            "there is no detector \"radar\"",
        ),
        (
            [&graph[..], &["--vehicle-detector", "files"]].concat(),
            "--detections FILE",
        ),
        ([&graph[..], &of_program].concat(), "missing.toml"),
    ] {
        let ended = run(&out.path(), &[&poses[..], &words].concat());
        out.assert_untouched(&ended, reason);
    }
}

#[test]
fn units_that_can_be_done() {
    let out = OutputPath::new();
    let (scene, video) = (small_run().out.join(SEQUENCE), sample("street.mp4"));
    let (scene, video) = (scene.to_str().unwrap(), video.to_str().unwrap());
    let (folder, other) = (out.path(), out.folder.path().join("other"));
    let (folder, other) = (folder.to_str().unwrap(), other.to_str().unwrap());
    let bench = [
        "sweep",
        "plan",
        "bench",
        scene,
        "--methods",
        "odgs",
        "--results",
    ];
    let bench = [&bench[..], &[other, "--out", folder, "--"]].concat();
    let curate = [
        "sweep",
        "plan",
        "curate",
        video,
        "--dataset",
        other,
        "--out",
    ];
    let curate = [&curate[..], &[folder]].concat();
    for (plan, options, reason) in [
        (&bench, ["--with", "no-such-part"], "no-such-part"),
        (&bench, ["--set", "no-such-option=1"], "no-such-option"),
        (&bench, ["--budget", "0"], "budget"),
    ] {
        let ended = omnilife([&plan[..], &options].concat());
        out.assert_untouched(&ended, reason);
    }
    for [option, value] in [["--min-shot", "nan"], ["--max-frames", "0"]] {
        let ended = omnilife([&curate[..], &[option, value]].concat());
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(option), "{}", ended.stderr);
        assert!(!out.path().exists(), "{:?}", files(&out.path()));
    }
}
