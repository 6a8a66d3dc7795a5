//! Bad input: exit code 2, one line that names the file and the reason, and nothing half-written.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::support::{
    SEQUENCE, SMALL, assert_all_whole, copy_of_small_run, files, footage, omnilife, run, sample,
    scratch, small_run,
};

/// Runs `omnilife --quiet run` without poses.
fn run_without_poses(video: &Path, out: &Path, further: &[&str]) -> crate::support::Ended {
    let mut arguments = vec!["--quiet".as_ref(), "run".as_ref(), video.as_os_str()];
    arguments.extend(["--out".as_ref(), out.as_os_str()]);
    arguments.extend(SMALL.iter().chain(further).map(std::ffi::OsStr::new));
    omnilife(arguments)
}

/// Runs the main job on a bad video. Checks that the error names the file and the reason, that the summary has the same
/// reason, and that all files on disk are whole.
#[track_caller]
fn assert_refused(video: &Path, reason: &str) {
    assert_refused_for(video, reason, reason);
}

/// Does the same where the table of outcomes has `recorded` in place of the advice to the user.
fn assert_refused_for(video: &Path, reason: &str, recorded: &str) {
    let folder = scratch();
    let out = folder.path().join("out");
    let mut arguments = SMALL.to_vec();
    arguments.push("--quiet");
    let ended = run(video, &out, &arguments);
    let message = ended.failed_quietly(2);
    let name = video.file_name().unwrap().to_str().unwrap();
    assert!(message.contains(name), "{message}");
    assert!(message.contains(reason), "{message}");
    assert!(ended.stdout.contains(reason), "{}", ended.stdout);
    assert!(
        !files(&out).iter().any(|file| file.contains("seq-")),
        "{:?}",
        files(&out)
    );
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    assert!(outcomes.contains("failed"), "{outcomes}");
    assert!(outcomes.contains(recorded), "{outcomes}");
    assert_all_whole(&out);
}

/// Checks that a request is refused before anything is written.
#[track_caller]
fn assert_request_refused(further: &[&str], reason: &str) {
    let folder = scratch();
    let out = folder.path().join("out");
    let mut arguments = vec!["--quiet"];
    arguments.extend(further);
    let ended = run(&sample("street.mp4"), &out, &arguments);
    let message = ended.failed_quietly(2);
    assert!(message.contains(reason), "{message}");
    assert_eq!(ended.stdout, "");
    assert!(!out.exists(), "{:?}", files(&out));
}

/// Asserts that an option is refused by its name and value before anything is written.
fn assert_option_refused(words: &[&str]) {
    let folder = scratch();
    let out = folder.path().join("out");
    let ended = run(&sample("street.mp4"), &out, words);
    let message = &ended.stderr;
    assert_eq!(ended.code, Some(2), "{message}");
    for part in words.iter().chain(&["must be"]) {
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(ended.stdout, "");
    assert!(!out.exists(), "{:?}", files(&out));
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_video_cut_short() {
    let folder = scratch();
    let bytes = fs::read(sample("street.mp4")).unwrap();
    // The index stands at the front: images are cut off first, then the index itself.
    for (name, part, reason) in [
        ("most.mp4", &bytes[..bytes.len() * 9 / 10], "is truncated"),
        ("third.mp4", &bytes[..bytes.len() / 3], "is truncated"),
        ("start.mp4", &bytes[..1000], "is truncated"),
        ("head.mp4", &bytes[..100], "has no video stream"),
    ] {
        assert_refused(&file(folder.path(), name, part), reason);
    }
}

#[test]
fn an_empty_file() {
    let folder = scratch();
    assert_refused(&file(folder.path(), "empty.mp4", b""), "is empty");
}

#[test]
fn a_text_named_as_a_video() {
    let folder = scratch();
    let text = "Frame by frame, nothing is here to be seen.\n".repeat(100);
    assert_refused(
        &file(folder.path(), "text.mp4", text.as_bytes()),
        "is not a video",
    );
}

#[test]
fn a_name_with_a_line_break_stays_on_one_line() {
    let folder = scratch();
    let video = file(folder.path(), "two\nlines.mp4", b"");
    let ended = run_without_poses(&video, &folder.path().join("out"), &[]);
    let message = ended.failed_quietly(2);
    assert!(
        message.ends_with("lines.mp4: is empty (0 bytes)"),
        "{message}"
    );
}

#[test]
fn a_video_without_a_video_stream() {
    let folder = scratch();
    let video = folder.path().join("sound.mp4");
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "lavfi", "-i", "sine=duration=1"])
        .arg(&video)
        .status();
    if !made.is_ok_and(|status| status.success()) {
        omnilife_schemas::testing::skip("there is no ffmpeg command that makes a sound file");
        return;
    }
    assert_refused(&video, "has no video stream");
}

#[test]
fn a_rectilinear_video_with_the_way_out() {
    let Some(video) = footage("bikes.mp4") else {
        return;
    };
    let (way_out, check) = ("its image is rectilinear", "projection is rectilinear");
    assert_refused_for(&video, way_out, check);
    assert_refused_for(&video, "--accept erp", "required: erp or erp-squeezed");
}

#[test]
fn a_video_of_two_fisheyes_with_the_way_out() {
    let folder = scratch();
    let video = folder.path().join("fisheyes.mp4");
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(sample("street.mp4"))
        .args(["-frames:v", "20", "-vf"])
        .arg("v360=e:dfisheye:h_fov=195:v_fov=195:w=512:h=256")
        .arg(&video)
        .status();
    if !made.is_ok_and(|status| status.success()) {
        omnilife_schemas::testing::skip("FFmpeg with its filter v360 is missing");
        return;
    }
    assert_refused_for(
        &video,
        "pass --projection dual-fisheye",
        "projection is fisheye",
    );
}

#[test]
fn paths_that_lead_to_no_video() {
    let folder = scratch();
    let empty = folder.path().join("papers");
    fs::create_dir(&empty).unwrap();
    file(&empty, "paper.pdf", b"");
    let missing = folder.path().join("missing.mp4");
    for (path, name, reason) in [
        (&empty, "papers", "holds no videos"),
        (&missing, "missing.mp4", "does not exist"),
    ] {
        let out = folder.path().join("out");
        let ended = run_without_poses(path, &out, &[]);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains(name) && message.contains(reason),
            "{message}"
        );
        assert!(!out.exists());
    }
}

#[test]
fn an_output_that_is_something_else() {
    let folder = scratch();
    let plain = file(folder.path(), "notes", b"keep me");
    let foreign = folder.path().join("holiday");
    fs::create_dir(&foreign).unwrap();
    file(&foreign, "notes", b"keep me");
    for (out, reason) in [(&plain, "is a file"), (&foreign, "is not empty")] {
        let ended = run(&sample("street.mp4"), out, &["--quiet"]);
        let message = ended.failed_quietly(2);
        assert!(message.contains(out.to_str().unwrap()), "{message}");
        assert!(message.contains(reason), "{message}");
    }
    assert_eq!(fs::read(&plain).unwrap(), b"keep me");
    assert_eq!(files(&foreign), ["notes"]);
}

#[test]
fn an_output_of_another_video() {
    let copy = copy_of_small_run();
    let before = files(copy.path());
    let folder = scratch();
    // The same images in another file are another input.
    let mut bytes = fs::read(sample("street.mp4")).unwrap();
    bytes.extend_from_slice(&[0, 0, 0, 8, b'f', b'r', b'e', b'e']);
    let other = file(folder.path(), "street.mp4", &bytes);
    let ended = run(&other, copy.path(), &["--quiet"]);
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("holds the results of another input"),
        "{message}"
    );
    assert!(message.contains(copy.path().to_str().unwrap()), "{message}");
    assert_eq!(files(copy.path()), before);
}

#[test]
fn poses_that_are_none_or_of_something_else() {
    let folder = scratch();
    let in_folder = |name: &str, text: &str| file(folder.path(), name, text.as_bytes());
    let frame = |seconds: f64| {
        format!(
            r#"{{"schema": "omnilife/poses/1", "scale": "metres", "points": null, "frames": [
            {{"time_seconds": {seconds}, "mask": null,
            "pose": {{"rotation_wxyz": [1, 0, 0, 0], "centre": [0, 0, 0]}}}}]}}"#
        )
    };
    let later = frame(1000.0);
    let lost = later.replace("null", "\"missing.ply\"");
    for (poses, reason) in [
        (in_folder("garbage.json", "}{"), "not a JSON record"),
        (in_folder("list.json", "[1, 2]"), "not a JSON record"),
        (in_folder("bare.json", "{}"), "has no \"schema\" entry"),
        (
            in_folder("later.json", &later),
            "fits no frame of street/seq-000",
        ),
        (
            in_folder("turned.json", &frame(0.0).replace("[1, 0,", "[0, 0,")),
            "has no rotation",
        ),
        (in_folder("lost.json", &lost), "missing.ply: cannot be read"),
        (folder.path().join("missing.json"), "does not exist"),
        (folder.path().to_owned(), "cameras.txt: cannot be read"),
    ] {
        let out = scratch();
        let poses_argument = ["--poses", poses.to_str().unwrap()];
        let ended = run_without_poses(&sample("street.mp4"), out.path(), &poses_argument);
        let message = ended.failed_quietly(2);
        assert!(message.contains(reason), "{message}");
        assert!(
            message.contains(folder.path().to_str().unwrap()),
            "{message}"
        );
        assert!(
            !files(out.path())
                .iter()
                .any(|file| file.ends_with("scene.json"))
        );
        assert_all_whole(out.path());
    }
}

#[test]
fn poses_of_one_video_for_two() {
    let (video, poses) = (sample("street.mp4"), sample("poses.json"));
    let (video, poses) = (video.to_str().unwrap(), poses.to_str().unwrap());
    let folder = scratch();
    let out = folder.path().join("out");
    let words = ["-q", "run", video, video, "--poses", poses, "--out"];
    let ended = omnilife(words.into_iter().chain([out.to_str().unwrap()]));
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("--poses belongs to one video"),
        "{message}"
    );
    assert!(!out.exists());
}

#[test]
fn names_that_are_not_known() {
    assert_request_refused(
        &["--method", "nerf"],
        "there is no method \"nerf\"; known: odgs",
    );
    assert_request_refused(&["--protocol", "mine"], "\"mine\"; known: per-scene");
    let criteria = "must be omnilife360, none or a .toml file, got \"best\"";
    assert_request_refused(&["--criteria", "best"], criteria);
}

#[test]
fn numbers_that_make_no_sense() {
    assert_request_refused(&["--set", "max-gaussians=0"], "1 at least");
    assert_request_refused(&["--width", "65"], "frame width of 65 pixels");
    let refused = "--iterations=0 --trace=0 --max-frames=0 --width=0 --fps=0 --fps=nan --budget=0 --min-shot=inf";
    for line in refused.split(' ') {
        assert_option_refused(&line.split('=').collect::<Vec<_>>());
    }
    assert_option_refused(&["--width", "-4"]);
}

#[test]
fn settings_that_do_not_fit_the_video() {
    for (arguments, reason) in [
        (
            ["--width", "514"],
            "514 pixels is more than the video's own 512",
        ),
        (["--min-shot", "3"], "none of its shots lasts 3 s"),
    ] {
        let folder = scratch();
        let out = folder.path().join("out");
        let mut with_quiet = arguments.to_vec();
        with_quiet.push("--quiet");
        let ended = run(&sample("street.mp4"), &out, &with_quiet);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains("street.mp4") && message.contains(reason),
            "{message}"
        );
        assert_all_whole(&out);
    }
}

#[test]
fn stages_that_are_given_nothing() {
    let folder = scratch();
    let missing = folder.path().join("missing");
    let missing = missing.to_str().unwrap();
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    for arguments in [
        vec!["curate", "probe", missing],
        vec!["curate", "projection", missing],
        vec!["curate", "boundaries", missing],
        vec!["curate", "build", missing, "--out", out],
        vec!["curate", "poses", missing, "--poses", missing],
        vec!["bench", "split", missing, "--out", out],
        vec![
            "reconstruct",
            "train",
            missing,
            "--split",
            missing,
            "--out",
            out,
        ],
        vec![
            "bench", "score", "--scene", missing, "--split", missing, "--run", missing, "--out",
            out,
        ],
        vec!["leaderboard", "build", missing, "--out", out],
    ] {
        let ended = omnilife(["--quiet"].iter().chain(&arguments));
        let message = ended.failed_quietly(2);
        assert!(message.contains(missing), "{arguments:?}: {message}");
        assert_eq!(ended.stdout, "");
        let left = if Path::new(out).exists() {
            files(Path::new(out))
        } else {
            vec![]
        };
        assert_eq!(left, [""; 0], "{arguments:?}");
    }
}

#[test]
fn requests_to_the_method_that_make_no_sense_are_refused() {
    assert_request_refused(&["--set", "sh-degree=4"], "a whole number, 0 to 3");
    assert_request_refused(
        &["--without", "sky"],
        "there is no odgs component \"sky\"; known: swept-points",
    );
}

#[test]
fn an_image_of_another_size_than_its_camera_is_refused() {
    let copy = copy_of_small_run();
    let sequence = copy.path().join(SEQUENCE);
    let image = sequence.join("frames/000003.png");
    image::RgbImage::new(64, 64).save(&image).unwrap();
    let out = copy.path().join("run");
    let ended = omnilife([
        "--quiet".as_ref(),
        "reconstruct".as_ref(),
        "train".as_ref(),
        sequence.join("scene.json").as_os_str(),
        "--split".as_ref(),
        sequence.join("per-scene/split.json").as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
    ]);
    let message = ended.failed_quietly(2);
    assert!(
        message.contains("000003.png") && message.contains("is 64x64"),
        "{message}"
    );
    assert!(!out.join("run.json").exists());
}

/// A split that gives views as input which are scored as held out.
#[test]
fn an_edited_split_trains_nothing() {
    let folder = scratch();
    let sequence = small_run().out.join(SEQUENCE);
    let text = fs::read_to_string(sequence.join("per-scene/split.json")).unwrap();
    let mut split: serde_json::Value = serde_json::from_str(&text).unwrap();
    let novel = split["novel_views"].as_array().unwrap().clone();
    let input = split["input_views"].as_array_mut().unwrap();
    input.extend(novel);
    input.sort_by_key(serde_json::Value::as_u64);
    let edited = folder.path().join("edited.json");
    fs::write(&edited, split.to_string()).unwrap();
    let (scene, out) = (sequence.join("scene.json"), folder.path().join("out"));
    for method in ["odgs", "cross-fade"] {
        let mut arguments = ["--quiet", "reconstruct", "train", "--method", method]
            .map(std::ffi::OsStr::new)
            .to_vec();
        arguments.extend([scene.as_os_str(), "--split".as_ref(), edited.as_os_str()]);
        arguments.extend(["--out".as_ref(), out.as_os_str()]);
        let ended = omnilife(arguments);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains("edited.json: is not the split of scene"),
            "{method}: {message}"
        );
        assert!(!out.join("run.json").exists());
    }
}

/// The user's limit counts as the machine's own does.
#[test]
fn a_model_beyond_the_memory_that_it_may_take_is_refused_before_training() {
    let run = &small_run().out;
    let folder = scratch();
    let out = folder.path().join("run");
    let sequence = run.join(SEQUENCE);
    let split = sequence.join("per-scene/split.json");
    for method in ["odgs", "nag"] {
        let ended = omnilife(
            ["--quiet", "reconstruct", "train"]
                .map(std::ffi::OsStr::new)
                .into_iter()
                .chain([sequence.as_os_str(), "--split".as_ref(), split.as_os_str()])
                .chain(["--method", method, "--memory", "0.0001"].map(AsRef::as_ref))
                .chain(["--iterations", "2", "--out"].map(AsRef::as_ref))
                .chain([out.as_os_str()]),
        );
        let message = ended.failed_quietly(2);
        assert!(
            message.contains("GiB of memory, 0.0 GiB are left"),
            "{message}"
        );
        assert!(!out.join("run.json").exists());
    }
}

#[test]
fn a_dataset_in_place_of_a_sequence_lists_its_sequences() {
    let dataset = &small_run().out;
    let sequence = dataset.join(SEQUENCE);
    for (words, part) in [
        (&["curate", "poses"][..], sequence.as_path()),
        (&["curate", "masks"][..], sequence.as_path()),
        (
            &["bench", "split", "--out", "split.json"][..],
            sequence.as_path(),
        ),
        (
            &["curate", "ledger", "show"][..],
            sequence.parent().unwrap(),
        ),
    ] {
        let words = words.iter().map(std::ffi::OsStr::new);
        let ended = omnilife(words.chain([dataset.as_os_str()]));
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        let part = part.to_str().unwrap();
        assert!(ended.stderr.contains(part), "{part}: {}", ended.stderr);
    }
}
