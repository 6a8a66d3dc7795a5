//! The pose of a sphere that its container states is recorded, told, and stated by slices; frames stay as they are.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_curate::{
    CurateSettings, curate_video,
    slicing::{SliceSettings, slice_segment},
};
use omnilife_schemas::{
    progress::Silent,
    records::{Sampling, Sequence, SphereTurn, SphericalMetadata},
    store,
    testing::Notes,
};
use omnilife_video::{Orientation, probe, writing::spherical_boxes::mark_equirectangular};
use support::erp_clip;

use crate::support;

/// 33.25, -12.5 and 170.0625 degrees in 16.16.
const NUMBERS: [i32; 3] = [0x0021_4000, -0x000c_8000, 0x00aa_1000];
const POSE: SphereTurn = SphereTurn {
    yaw_degrees: 33.25,
    pitch_degrees: -12.5,
    roll_degrees: 170.0625,
};

/// Returns the place where the numbers of the only `prhd` box begin.
fn place(bytes: &[u8]) -> usize {
    bytes.windows(4).position(|word| word == b"prhd").unwrap() + 8
}

/// A clip of an equirectangular world with these numbers in its `prhd` box.
fn posed(folder: &Path, name: &str, numbers: [i32; 3]) -> PathBuf {
    let video = erp_clip(folder, name, &[1], 30, 30);
    mark_equirectangular(&video, Orientation::default()).unwrap();
    let mut bytes = fs::read(&video).unwrap();
    let at = place(&bytes);
    assert_eq!(bytes[at..at + 12], [0; 12]);
    bytes[at..at + 12].copy_from_slice(numbers.map(i32::to_be_bytes).as_flattened());
    fs::write(&video, bytes).unwrap();
    video
}

fn stated(video: &Path) -> SphericalMetadata {
    probe(video).unwrap().spherical.unwrap()
}

#[test]
fn slices_state_the_pose_of_their_source() {
    let temp = tempfile::tempdir().unwrap();
    let video = posed(temp.path(), "walk.mp4", NUMBERS);
    let found = stated(&video);
    assert_eq!((found.pose, found.initial_view), (Some(POSE), None));
    assert_eq!((found.turn_fault, found.origin.as_str()), (None, "v2"));
    // Copied, and encoded again.
    for (name, begin) in [("copied.mp4", None), ("encoded.mp4", Some(0.2))] {
        let out = temp.path().join(name);
        let settings = SliceSettings { audio: false };
        slice_segment(&video, begin, None, &out, settings, &Silent).unwrap();
        assert_eq!(stated(&out).pose, Some(POSE), "{name}");
        let bytes = fs::read(&out).unwrap();
        let at = place(&bytes);
        let written = bytes[at..at + 12].as_chunks::<4>().0;
        let written: Vec<i32> = written
            .iter()
            .map(|word| i32::from_be_bytes(*word))
            .collect();
        assert_eq!(written, NUMBERS, "{name}");
    }
}

#[test]
fn a_sequence_records_the_pose_and_a_line_tells_it() {
    let temp = tempfile::tempdir().unwrap();
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(2),
        minimum_shot_seconds: 0.5,
        ..CurateSettings::default()
    };
    let curated = |numbers: [i32; 3], name: &str| {
        let video = posed(temp.path(), &format!("{name}.mp4"), numbers);
        let (out, notes) = (temp.path().join(name), Notes::default());
        let sequences = curate_video(&video, &out, &settings, &notes).unwrap();
        let record = out.join(&sequences[0]).join("sequence.json");
        let sequence: Sequence = store::read_record(&record).unwrap();
        let told = notes.take();
        let told = told.iter().filter(|line| line.contains("yaw")).count();
        (sequence.probe.spherical.unwrap(), told)
    };
    let (posed, told) = curated(NUMBERS, "posed");
    assert_eq!((posed.pose, told), (Some(POSE), 1));
    let (level, told) = curated([0; 3], "level");
    assert_eq!((level.pose, level.turn_fault, told), (None, None, 0));
    // 200 degrees of yaw, 90.5 of pitch.
    for (name, numbers) in [("wide", [200 << 16, 0, 0]), ("steep", [0, 181 << 15, 0])] {
        let (beyond, told) = curated(numbers, name);
        assert_eq!((beyond.pose, told), (None, 1), "{name}");
        assert!(beyond.turn_fault.is_some(), "{name}");
    }
}

/// FFmpeg writes it into the elements `ProjectionPoseYaw`, `ProjectionPosePitch` and `ProjectionPoseRoll`.
#[test]
fn matroska_states_the_same_pose() {
    let temp = tempfile::tempdir().unwrap();
    let video = posed(temp.path(), "walk.mp4", NUMBERS);
    let matroska = temp.path().join("walk.mkv");
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-y", "-i"]);
    let ended = command.arg(&video).args(["-c", "copy"]).arg(&matroska);
    assert!(ended.status().unwrap().success());
    let found = stated(&matroska);
    assert_eq!(
        (found.pose, found.origin.as_str()),
        (Some(POSE), "container")
    );
}

/// A slice says of itself that it is a whole sphere of one eye.
#[test]
fn other_layouts_are_not_sliced() {
    let temp = tempfile::tempdir().unwrap();
    let settings = SliceSettings { audio: false };
    let out = temp.path().join("slice.mp4");
    let whole = erp_clip(temp.path(), "walk.mp4", &[1], 30, 30);
    mark_equirectangular(&whole, Orientation::default()).unwrap();
    let mut bytes = fs::read(&whole).unwrap();
    // The stereo mode of the box `st3d`: version, flags, mode.
    let at = bytes.windows(4).position(|word| word == b"st3d").unwrap() + 8;
    assert_eq!(bytes[at], 0);
    bytes[at] = 1;
    let stereo = temp.path().join("stereo.mp4");
    fs::write(&stereo, bytes).unwrap();
    let refusal = slice_segment(&stereo, None, None, &out, settings, &Silent).unwrap_err();
    assert!(refusal.to_string().contains("top and bottom"), "{refusal}");
    assert!(!out.exists());
    slice_segment(&whole, None, None, &out, settings, &Silent).unwrap();
}
