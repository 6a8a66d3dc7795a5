//! Several videos at once: a bad one does not stop the others.

use std::{
    ffi::OsStr,
    fmt::Write as _,
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

use assert_cmd::cargo::cargo_bin_cmd;
use omnilife_schemas::{
    Pose,
    records::{Dataset, VideoStatus, poses::Poses},
    store,
};

use crate::support::{Ended, SMALL, SMALL_SIZE, assert_all_whole, sample, scratch};

/// Writes the sample with some empty boxes at its end: the same images in files that are not duplicates.
fn write_sample(file: &Path, boxes: usize) {
    let mut video = fs::read(sample("street.mp4")).unwrap();
    video.extend(b"\0\0\0\x08free".repeat(boxes));
    fs::write(file, video).unwrap();
}

/// Writes three videos, of which the second is empty.
fn three_videos(folder: &Path) {
    fs::create_dir(folder).unwrap();
    write_sample(&folder.join("a.mp4"), 0);
    write_sample(&folder.join("c.mp4"), 1);
    fs::write(folder.join("b.mp4"), []).unwrap();
}

/// Returns world to camera as COLMAP writes it: quaternion and translation.
fn colmap_pose(pose: &Pose) -> String {
    let inverse = pose.rotation().unwrap().inverse();
    let t = -(inverse * pose.centre());
    let q = inverse;
    format!("{} {} {} {} {} {} {}", q.w, q.x, q.y, q.z, t.x, t.y, t.z)
}

/// Writes a stand-in for the interpreter with pycolmap, which answers every call with the sample's true poses as a
/// text model. Returns the script's path.
fn known_poses_as_structure_from_motion(folder: &Path) -> PathBuf {
    let model = folder.join("model");
    fs::create_dir(&model).unwrap();
    let (width, height) = SMALL_SIZE;
    let camera = format!("1 EQUIRECTANGULAR {width} {height} {width} {height}\n");
    fs::write(model.join("cameras.txt"), camera).unwrap();
    let poses: Poses = store::read_record(&sample("poses.json")).unwrap();
    let mut images = String::new();
    for (index, frame) in poses.frames.iter().step_by(6).enumerate() {
        let pose = colmap_pose(&frame.pose);
        writeln!(images, "{} {pose} 1 {index:06}.png\n", index + 1).unwrap();
    }
    fs::write(model.join("images.txt"), images).unwrap();
    fs::write(model.join("points3D.txt"), "").unwrap();

    let script = folder.join("python");
    let text = format!(
        "#!/bin/sh
if [ \"$1\" = -c ]; then echo 4.1.0; exit; fi
while [ \"$1\" != --out ]; do shift; done
cp -r '{}' \"$2/sparse\" && echo models 1
",
        model.display()
    );
    fs::write(&script, text).unwrap();
    fs::set_permissions(&script, fs::Permissions::from_mode(0o755)).unwrap();
    script
}

fn run_all(videos: &Path, out: &Path, python: &Path) -> Ended {
    let words = ["--quiet".as_ref(), "run".as_ref(), videos.as_os_str()];
    let output = cargo_bin_cmd!("omnilife")
        .env("OMNILIFE_SFM_PYTHON", python)
        .args(words)
        .args(["--out".as_ref(), out.as_os_str()])
        .args(SMALL.map(OsStr::new))
        .output()
        .unwrap();
    Ended {
        code: output.status.code(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

#[test]
fn the_others_are_scored_and_the_bad_one_can_be_repaired() {
    let folder = scratch();
    let (videos, out) = (folder.path().join("videos"), folder.path().join("out"));
    three_videos(&videos);
    let python = known_poses_as_structure_from_motion(folder.path());

    let ended = run_all(&videos, &out, &python);
    let message = ended.failed_quietly(2);
    assert!(message.starts_with("1 of 3 "), "{message}");
    assert!(message.contains("b.mp4: is empty"), "{message}");
    let said = |text: &str| assert!(ended.stdout.contains(text), "{text}: {}", ended.stdout);
    said("| a/seq-000  ");
    said("| c/seq-000  ");
    said("mean of 2 of 2 scenes");
    said("scored  a/seq-000");
    said("scored  c/seq-000");
    said("b.mp4: is empty (0 bytes)");
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    let rows: Vec<&str> = outcomes.lines().collect();
    assert_eq!(rows.len(), 4, "{outcomes}");
    assert!(rows[2].contains("b.mp4,,failed,") && rows[2].contains("is empty"));
    let dataset: Dataset = store::read_record(&out.join("dataset.json")).unwrap();
    assert!(matches!(
        dataset.videos[1].status,
        VideoStatus::Failed { .. }
    ));
    assert!(!out.join("videos/b").exists());

    write_sample(&videos.join("b.mp4"), 2);
    let ended = run_all(&videos, &out, &python).succeeded();
    assert_eq!(ended.stdout.matches("scored  ").count(), 3);

    // A sequence that fails this time does not stay in the table with its earlier scores: its scene is gone, and
    // structure from motion fails.
    fs::remove_file(out.join("videos/a/seq-000/scene.json")).unwrap();
    let script = fs::read_to_string(&python).unwrap();
    let (head, _) = script.split_once("cp -r").unwrap();
    fs::write(&python, format!("{head}echo models 0\n")).unwrap();
    let ended = run_all(&videos, &out, &python);
    let message = ended.failed_quietly(1);
    assert!(message.contains("a/seq-000"), "{message}");
    for text in [
        &ended.stdout,
        &fs::read_to_string(out.join("table.md")).unwrap(),
    ] {
        assert!(
            text.contains("| c/seq-000 ") && !text.contains("| a/seq-000 "),
            "{text}\n{message}"
        );
    }
}

#[test]
fn all_bad_ones_are_named() {
    let folder = scratch();
    let videos = folder.path().join("videos");
    fs::create_dir(&videos).unwrap();
    fs::write(videos.join("a.mp4"), []).unwrap();
    fs::write(videos.join("b.mp4"), "no video").unwrap();
    let out = folder.path().join("out");
    let python = known_poses_as_structure_from_motion(folder.path());
    let ended = run_all(&videos, &out, &python);
    let message = ended.failed_quietly(2);
    assert!(message.starts_with("2 of 2 "), "{message}");
    assert!(message.contains("a.mp4: is empty"), "{message}");
    assert!(ended.stdout.contains("b.mp4: is not a video"));
    assert_all_whole(&out);
    assert!(!out.join("table.md").exists());
}

/// Runs the `ffmpeg` program in a folder.
fn ffmpeg(folder: &Path, arguments: &str) {
    let made = std::process::Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-y"])
        .args(arguments.split(' '))
        .current_dir(folder)
        .status()
        .unwrap();
    assert!(made.success(), "ffmpeg {arguments}");
}

/// A video that needs more memory than its limit has failed; the videos before and after it give the same results as
/// alone.
#[test]
#[cfg(target_os = "linux")]
fn a_video_that_takes_too_much_memory_stops_no_other() {
    let folder = scratch();
    let videos = folder.path().join("videos");
    three_videos(&videos);
    fs::remove_file(videos.join("b.mp4")).unwrap();
    let huge = "-f lavfi -i color=s=15360x7680:d=1:r=5 -c:v mjpeg b.mkv";
    ffmpeg(&videos, huge);
    let curate = |out: &Path, memory: &str| {
        let mut command = cargo_bin_cmd!("omnilife");
        command.args(["--quiet", "curate"]).arg(&videos);
        command.args(["--criteria", "none", "--accept", "erp", "--memory", memory]);
        command.args(&SMALL[..4]).arg("--out").arg(out);
        let output = command.output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), stderr)
    };
    let out = folder.path().join("out");
    let (code, stderr) = curate(&out, "0.4");
    assert!(matches!(code, Some(1 | 2)), "{code:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(
        stderr.contains("1 of 3 videos") && stderr.contains("b.mkv"),
        "{stderr}"
    );
    let dataset: Dataset = store::read_record(&out.join("dataset.json")).unwrap();
    for (video, is_curated) in dataset.videos.iter().zip([true, false, true]) {
        let found = matches!(video.status, VideoStatus::Curated { .. });
        assert_eq!(found, is_curated, "{video:?}");
    }
}
