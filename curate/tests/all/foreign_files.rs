//! Users' files in a sequence's folder, or a video's, survive every stage.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};
use omnilife_curate::{
    CurateSettings, PoseRequest, curate_video,
    masks::{MaskSource, write_masks},
    pose_sequence,
    slicing::{SliceSettings, slice_segment},
};
use omnilife_schemas::{
    Classified, ErrorKind, Pose,
    progress::Silent,
    records::{PosedFrame, Poses, Scale},
    store,
};
use support::erp_clip;

use crate::support;

fn settings() -> CurateSettings {
    CurateSettings {
        enforce: false,
        ..CurateSettings::default()
    }
}

/// A curated sequence of 20 frames at 10 fps beneath `folder`.
fn sequence(folder: &Path) -> PathBuf {
    let video = erp_clip(folder, "walk.mp4", &[1], 20, 10);
    curate_video(&video, &folder.join("walk"), &settings(), &Silent).unwrap();
    folder.join("walk/seq-000")
}

/// Poses on a line; the fifth frame has a mask where one is named.
fn write_poses(file: &Path, step: f64, mask: Option<&str>) -> PoseRequest {
    let frames = (0..20)
        .map(|index| PosedFrame {
            time_seconds: f64::from(index) * 0.1,
            pose: Pose::from_matrix(DMat3::IDENTITY, DVec3::X * step * f64::from(index)).unwrap(),
            mask: mask.filter(|_| index == 4).map(str::to_owned),
        })
        .collect();
    let record = Poses::new(Scale::Metres, None, frames);
    store::write_record(file, &record).unwrap();
    PoseRequest::Given(file.to_owned())
}

fn write(path: &Path, content: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

/// A mask of frame size with values between black and white, as matting gives.
fn write_grey(path: &Path, level: u8) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let levels = vec![level; 256 * 128];
    image::save_buffer(path, &levels, 256, 128, image::ColorType::L8).unwrap();
}

#[test]
fn posing_removes_what_it_made_and_nothing_else() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence(temp.path());
    let given = temp.path().join("given.json");
    let foreign = [
        "masks/notes.txt",
        "masks/000009.png",
        "depth/000000.png",
        "classes/human/000000.png",
        "points.ply",
    ];
    for file in foreign {
        write(&sequence.join(file), "mine");
    }
    let check = || {
        for file in foreign {
            assert_eq!(fs::read(sequence.join(file)).unwrap(), b"mine", "{file}");
        }
    };
    let bare = write_poses(&given, 1.0, None);
    assert_eq!(
        pose_sequence(&sequence, &bare, &Silent).unwrap().points,
        None
    );
    check();
    write_grey(&temp.path().join("m.png"), 255);
    let masked = write_poses(&given, 1.0, Some("m.png"));
    let scene = pose_sequence(&sequence, &masked, &Silent).unwrap();
    assert_eq!(scene.frames[4].mask.as_deref(), Some("masks/000004.png"));
    let made = sequence.join("masks/000004.png");
    assert!(made.is_file());
    check();
    // Somebody touches it up: from now on it is theirs.
    let own = fs::read(&made).unwrap();
    write_grey(&made, 0);
    let error = pose_sequence(&sequence, &masked, &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(
        error
            .to_string()
            .contains("masks/000004.png: is in the way")
    );
    fs::write(&made, own).unwrap();
    pose_sequence(&sequence, &masked, &Silent).unwrap();
    let bare = write_poses(&given, 2.0, None);
    pose_sequence(&sequence, &bare, &Silent).unwrap();
    assert!(!made.exists(), "a mask of earlier poses");
    check();
}

#[test]
fn grey_masks_of_the_user_stay_grey() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence(temp.path());
    let mask = sequence.join("masks/000004.png");
    write_grey(&mask, 200);
    let before = fs::read(&mask).unwrap();
    let given = sequence.join("poses.json");
    let request = write_poses(&given, 1.0, Some("masks/000004.png"));
    let scene = pose_sequence(&sequence, &request, &Silent).unwrap();
    assert_eq!(scene.frames[4].mask.as_deref(), Some("masks/000004.png"));
    assert_eq!(fs::read(&mask).unwrap(), before);
    let request = write_poses(&given, 2.0, None);
    pose_sequence(&sequence, &request, &Silent).unwrap();
    assert_eq!(fs::read(&mask).unwrap(), before, "it was never ours");
}

#[test]
fn two_poses_of_one_instant_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence(temp.path());
    let given = temp.path().join("given.json");
    write_poses(&given, 1.0, None);
    let mut record: Poses = store::read_record(&given).unwrap();
    record.frames.push(record.frames[3].clone());
    store::write_record(&given, &record).unwrap();
    let request = PoseRequest::Given(given.clone());
    pose_sequence(&sequence, &request, &Silent).unwrap();
    record.frames[20].pose.centre[1] += 1.0;
    store::write_record(&given, &record).unwrap();
    let message = pose_sequence(&sequence, &request, &Silent).unwrap_err();
    assert!(
        message.to_string().contains("two poses at 0.3"),
        "{message}"
    );
}

#[test]
fn dynamic_masks_of_the_user_are_not_replaced() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence(temp.path());
    let given = temp.path().join("given");
    for index in 0..20 {
        write_grey(&given.join(format!("{index:06}.png")), 255);
    }
    let source = MaskSource::Files(given);
    let mine = sequence.join("dynamic-masks/000003.png");
    write(&mine, "mine");
    let message = write_masks(&sequence, &source, &Silent).unwrap_err();
    assert!(message.to_string().contains("is in the way"), "{message}");
    assert_eq!(fs::read(&mine).unwrap(), b"mine");
    assert!(!sequence.join("dynamic-masks/000000.png").exists());
    fs::rename(&mine, mine.with_file_name("notes")).unwrap();
    write_masks(&sequence, &source, &Silent).unwrap();
    assert_eq!(fs::read(mine.with_file_name("notes")).unwrap(), b"mine");
}

#[test]
fn slices_stay_beside_what_the_user_keeps_there() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1], 20, 10);
    let folder = temp.path().join("walk");
    let sliced = CurateSettings {
        slices: Some(SliceSettings { audio: false }),
        ..settings()
    };
    curate_video(&video, &folder, &sliced, &Silent).unwrap();
    let notes = folder.join("slices/notes.txt");
    fs::write(&notes, "mine").unwrap();
    let slice = folder.join("slices/seq-000.mp4");
    assert!(slice.is_file());
    curate_video(&video, &folder, &settings(), &Silent).unwrap();
    assert!(!slice.exists() && notes.is_file());
    fs::write(&slice, "mine").unwrap();
    let message = curate_video(&video, &folder, &sliced, &Silent).unwrap_err();
    assert!(message.to_string().contains("is in the way"), "{message}");
    assert_eq!(fs::read(&slice).unwrap(), b"mine");
}

#[test]
fn a_slice_replaces_no_file_and_not_its_source() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1], 20, 10);
    let before = fs::read(&video).unwrap();
    let (none, settings) = (None, SliceSettings { audio: false });
    let error = slice_segment(&video, none, Some(0.5), &video, settings, &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().contains("exists already"), "{error}");
    assert_eq!(fs::read(&video).unwrap(), before);
    let out = temp.path().join("slice.mp4");
    slice_segment(&video, none, Some(0.5), &out, settings, &Silent).unwrap();
    assert_eq!(
        store::names_in(temp.path()).unwrap(),
        ["slice.mp4", "walk.mp4"]
    );
}

/// Frames that somebody has worked on are set aside with the sequence, not removed.
#[test]
fn changed_frames_are_set_aside() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence(temp.path());
    fs::write(sequence.join("frames/000003.png"), "retouched").unwrap();
    let fewer = CurateSettings {
        sampling: omnilife_schemas::records::Sampling::MaxFrames(5),
        ..settings()
    };
    let video = temp.path().join("walk.mp4");
    curate_video(&video, &temp.path().join("walk"), &fewer, &Silent).unwrap();
    let aside = temp
        .path()
        .join("walk/.superseded/seq-000-1/frames/000003.png");
    assert_eq!(fs::read(aside).unwrap(), b"retouched");
}
