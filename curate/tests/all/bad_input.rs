//! Every kind of bad input: a typed error of one line that names the file, and nothing half-written.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{
    CurateError, CurateSettings, curate_video, expand_inputs, left_out_of_folders,
};
use omnilife_schemas::{Classified, ErrorKind, progress::Silent};
use support::{Clip, erp_clip};

use crate::support;

fn lenient() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        enforce: false,
        ..CurateSettings::default()
    }
}

/// Curates and expects an error that names `named`, on one line, with the given blame; returns its message. Any file in
/// the output then is hidden or a complete record.
fn refused(video: &Path, out: &Path, named: &Path, blame: ErrorKind) -> String {
    let error = curate_video(video, out, &lenient(), &Silent).unwrap_err();
    let message = error.to_string();
    assert_eq!(error.error_kind(), blame, "{message}");
    assert!(!message.contains('\n'), "{message}");
    assert!(message.contains(&named.display().to_string()), "{message}");
    assert!(!out.join("seq-000").exists(), "a sequence was left behind");
    assert!(
        !out.join("analysis.json").exists(),
        "an analysis was left behind"
    );
    message
}

#[test]
fn files_that_are_no_videos() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    for (name, content, reason) in [
        ("empty.mp4", Vec::new(), "empty"),
        ("text.mp4", b"dear diary,\n".repeat(200), "not a video"),
        (
            "noise.mp4",
            (0..60_000_u32).map(|i| ((i * i) >> 7) as u8).collect(),
            "not a video",
        ),
    ] {
        let video = temp.path().join(name);
        fs::write(&video, content).unwrap();
        let message = refused(&video, &out, &video, ErrorKind::User);
        assert!(message.contains(reason), "{message}");
    }
    let missing = temp.path().join("missing.mp4");
    let message = refused(&missing, &out, &missing, ErrorKind::User);
    assert!(message.contains("cannot be read"), "{message}");
    refused(temp.path(), &out, temp.path(), ErrorKind::User);
}

/// A playlist that names another file is not a video: nothing but the file itself is opened.
#[test]
fn a_playlist_named_mp4_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    let clip = erp_clip(temp.path(), "clip.mp4", &[1], 10, 30);
    let list = temp.path().join("list.mp4");
    let hls = format!(
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n",
        clip.display()
    );
    let concat = "ffconcat version 1.0\nfile clip.mp4\n";
    for text in [&hls, concat] {
        fs::write(&list, text).unwrap();
        let message = refused(&list, &temp.path().join("out"), &list, ErrorKind::User);
        assert!(message.contains("is not a video"), "{message}");
    }
}

#[test]
fn sound_without_images() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("sound.mp4");
    // A second of silence as 8 kHz 16-bit WAV.
    let samples = vec![0_u8; 16_000];
    let mut wav = Vec::new();
    wav.extend_from_slice(b"RIFF");
    wav.extend_from_slice(&(36 + samples.len() as u32).to_le_bytes());
    wav.extend_from_slice(b"WAVEfmt \x10\0\0\0\x01\0\x01\0");
    wav.extend_from_slice(&8_000_u32.to_le_bytes());
    wav.extend_from_slice(&16_000_u32.to_le_bytes());
    wav.extend_from_slice(b"\x02\0\x10\0data");
    wav.extend_from_slice(&(samples.len() as u32).to_le_bytes());
    wav.extend_from_slice(&samples);
    fs::write(&video, wav).unwrap();
    let message = refused(&video, &temp.path().join("out"), &video, ErrorKind::User);
    assert!(message.contains("is not a video"), "{message}");
}

fn cut_off(whole: &Path, name: &str, share: f64) -> PathBuf {
    let bytes = fs::read(whole).unwrap();
    let path = whole.with_file_name(name);
    fs::write(&path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
    path
}

/// Cut off anywhere, with its index before or behind its frames, in containers of two kinds.
#[test]
fn truncated_videos() {
    let temp = tempfile::tempdir().unwrap();
    let paint = |frame: usize, x: usize, y: usize| {
        support::world_colour(
            1,
            support::erp_direction(x, y, 256, 128, 0.01 * frame as f64),
        )
    };
    // Matroska's packets carry no sizes of what is missing: there only the stated duration tells,
    // and half a second of difference is tolerated.
    for (name, index_first, shares) in [
        ("behind.mp4", false, [0.3, 0.6, 0.95]),
        ("before.mp4", true, [0.3, 0.6, 0.95]),
        ("clip.mkv", false, [0.3, 0.6, 0.8]),
    ] {
        let whole = temp.path().join(name);
        let mut clip = Clip::steady(256, 128, 90, 30);
        clip.index_first = index_first;
        clip.write(&whole, paint);
        let out = temp.path().join("whole").join(name);
        curate_video(&whole, &out, &lenient(), &Silent).unwrap();
        for share in shares {
            let cut = cut_off(&whole, &format!("cut-{name}"), share);
            let message = refused(&cut, &temp.path().join("out"), &cut, ErrorKind::User);
            assert!(
                message.contains("truncated"),
                "{share} of {name}: {message}"
            );
        }
    }
}

#[test]
fn folders_without_videos_and_missing_inputs() {
    let temp = tempfile::tempdir().unwrap();
    fs::write(temp.path().join("notes.txt"), "no video").unwrap();
    let error = expand_inputs(&[temp.path().to_owned()]).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().contains("holds no videos"), "{error}");
    let missing = temp.path().join("missing");
    let error = expand_inputs(&[missing]).unwrap_err();
    assert!(error.to_string().contains("does not exist"), "{error}");

    for name in ["b.MP4", "a.mov", "c.mkv"] {
        fs::write(temp.path().join(name), "").unwrap();
    }
    let names: Vec<_> = expand_inputs(&[temp.path().to_owned()])
        .unwrap()
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, ["a.mov", "b.MP4", "c.mkv"]);
}

#[test]
fn videos_of_a_folder_that_are_not_taken_are_named() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("card");
    for file in [
        "a.mp4",
        "notes.txt",
        "b.MTS",
        "c.mts",
        "GS01.360",
        "trip/day/d.mp4",
        "trip/e.insv",
        "stills/f.jpg",
        ".trash/g.mp4",
    ] {
        let path = folder.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "").unwrap();
    }
    let inputs = [folder.clone(), folder.join("a.mp4")];
    let videos = expand_inputs(&inputs).unwrap();
    let left_out = left_out_of_folders(&inputs, &videos).unwrap();
    let lines = left_out.lines;
    assert_eq!(lines.len(), 1);
    for part in ["1 .360", "2 .mts", "2 in the folder trip"] {
        assert!(lines[0].contains(part), "{part}: {lines:?}");
    }
    for other in ["stills", "trash", "txt", ".mp4,"] {
        assert!(!lines[0].contains(other), "{other}: {lines:?}");
    }
    let files: Vec<&str> = left_out
        .files
        .iter()
        .map(|file| file.file.as_str())
        .collect();
    assert_eq!(
        files,
        [
            "GS01.360",
            "b.MTS",
            "c.mts",
            "trip/day/d.mp4",
            "trip/e.insv"
        ]
    );
    // A named file is taken.
    let inputs = [
        folder.clone(),
        folder.join("trip/../c.mts"),
        folder.join("trip/day"),
    ];
    let videos = expand_inputs(&inputs).unwrap();
    let others = left_out_of_folders(&inputs, &videos).unwrap().files;
    let files: Vec<&str> = others.iter().map(|file| file.file.as_str()).collect();
    assert_eq!(files, ["GS01.360", "b.MTS", "trip/e.insv"]);
    // If nothing is taken, the refusal lists the existing files.
    let error = expand_inputs(&[folder.join("trip")]).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("1 .insv") && message.contains("1 in the folder day"),
        "{message}"
    );
    let plain = [folder.join("trip/day")];
    let videos = expand_inputs(&plain).unwrap();
    let none = left_out_of_folders(&plain, &videos).unwrap();
    assert!(none.lines.is_empty() && none.files.is_empty());
}

/// macOS writes a file `._NAME` beside each file of a camera's card.
#[test]
fn hidden_files_of_a_folder_are_not_taken() {
    let temp = tempfile::tempdir().unwrap();
    let folders = ["videos", "stills"].map(|name| temp.path().join(name));
    for (folder, files) in folders.iter().zip([
        ["a.mp4", "._a.mp4", "._b.insv", ".DS_Store"],
        ["1.jpg", "._1.jpg", "2.png", "3.webp"],
    ]) {
        fs::create_dir(folder).unwrap();
        for file in files {
            fs::write(folder.join(file), "").unwrap();
        }
    }
    let videos = expand_inputs(&folders).unwrap();
    assert_eq!(videos, [folders[0].join("a.mp4"), folders[1].clone()]);
    let others = left_out_of_folders(&folders, &videos).unwrap().files;
    let files: Vec<&str> = others.iter().map(|file| file.file.as_str()).collect();
    assert_eq!(files, ["._a.mp4", "._b.insv", "._1.jpg", "3.webp"]);
    // A named file is taken.
    let named = [folders[0].join("._a.mp4")];
    assert_eq!(expand_inputs(&named).unwrap(), named);
}

#[test]
fn output_folders_that_belong_to_something_else() {
    let temp = tempfile::tempdir().unwrap();
    let one = erp_clip(temp.path(), "one.mp4", &[1], 40, 30);
    let other = erp_clip(temp.path(), "other.mp4", &[2], 40, 30);
    let out = temp.path().join("out");
    curate_video(&one, &out, &lenient(), &Silent).unwrap();
    let before = fs::read(out.join("seq-000/sequence.json")).unwrap();
    let error = curate_video(&other, &out, &lenient(), &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(
        error.to_string().contains("holds another input (one.mp4"),
        "{error}"
    );
    assert_eq!(fs::read(out.join("seq-000/sequence.json")).unwrap(), before);

    let foreign = temp.path().join("foreign");
    fs::create_dir(&foreign).unwrap();
    fs::write(foreign.join("thesis.tex"), "mine").unwrap();
    let message = refused(&one, &foreign, &foreign, ErrorKind::User);
    assert!(message.contains("not empty"), "{message}");
    assert_eq!(fs::read_dir(&foreign).unwrap().count(), 1);

    let file = temp.path().join("file");
    fs::write(&file, "mine").unwrap();
    refused(&one, &file, &file, ErrorKind::User);
    let below = file.join("out");
    refused(&one, &below, &below, ErrorKind::User);
}

/// The device accepts no byte, like a full disk: an incomplete file does not appear at all.
#[cfg(target_os = "linux")]
#[test]
fn a_write_that_fails_leaves_nothing_behind() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "one.mp4", &[1], 40, 30);
    let out = temp.path().join("out");
    fs::create_dir(&out).unwrap();
    // The temporary name of the signals is taken by a device that is always full.
    let temporary = omnilife_schemas::store::temporary_beside(&out.join("signals.parquet"));
    std::os::unix::fs::symlink("/dev/full", temporary).unwrap();
    let message = refused(&video, &out, &out, ErrorKind::Internal);
    assert!(message.contains("cannot be written"), "{message}");
    assert!(!out.join("signals.parquet").exists());
}

#[test]
fn settings_that_make_no_sense() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "one.mp4", &[1], 10, 30);
    let sampling = omnilife_schemas::records::Sampling::FramesPerSecond(f64::NAN);
    let wrong = [
        CurateSettings {
            sampling,
            ..lenient()
        },
        CurateSettings {
            width: Some(4096),
            ..lenient()
        },
        CurateSettings {
            width: Some(101),
            ..lenient()
        },
        CurateSettings {
            minimum_shot_seconds: -1.0,
            ..lenient()
        },
        CurateSettings {
            profile: "strict".to_owned(),
            ..lenient()
        },
        CurateSettings {
            detector: "oracle".to_owned(),
            ..lenient()
        },
        CurateSettings {
            accept: Some(omnilife_schemas::records::VideoProjection::ErpStereoTb),
            ..lenient()
        },
    ];
    for settings in wrong {
        let out = temp.path().join("out");
        let error = curate_video(&video, &out, &settings, &Silent).unwrap_err();
        assert!(matches!(error, CurateError::Input { .. }), "{error}");
        assert!(!out.exists());
    }
}

/// Runs the `ffmpeg` program in a folder.
fn ffmpeg(folder: &Path, arguments: &str) {
    let made = std::process::Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-y"])
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .status()
        .unwrap();
    assert!(made.success(), "ffmpeg {arguments}");
}

#[test]
fn frames_that_change_their_size() {
    let temp = tempfile::tempdir().unwrap();
    erp_clip(temp.path(), "one.mp4", &[1], 30, 30);
    ffmpeg(temp.path(), "-i one.mp4 -c:v mpeg2video -f mpegts a.ts");
    ffmpeg(
        temp.path(),
        "-i one.mp4 -vf scale=320:160 -c:v mpeg2video -output_ts_offset 1 -f mpegts b.ts",
    );
    let both = temp.path().join("both.ts");
    let bytes = [
        fs::read(temp.path().join("a.ts")),
        fs::read(temp.path().join("b.ts")),
    ]
    .map(Result::unwrap)
    .concat();
    fs::write(&both, bytes).unwrap();
    let message = refused(&both, &temp.path().join("out"), &both, ErrorKind::User);
    assert!(message.contains("256x128 to 320x160"), "{message}");
}

/// Streams whose timestamps begin below zero (the container's edit list hides those frames) or that
/// have none are read as far as they can be.
#[test]
fn negative_and_missing_timestamps() {
    let temp = tempfile::tempdir().unwrap();
    erp_clip(temp.path(), "one.mp4", &[1], 40, 20);
    ffmpeg(
        temp.path(),
        "-i one.mp4 -c copy -output_ts_offset -1 -avoid_negative_ts disabled early.mov",
    );
    ffmpeg(temp.path(), "-i one.mp4 -c copy old.avi");
    for name in ["early.mov", "old.avi"] {
        let out = temp.path().join("out").join(name);
        curate_video(&temp.path().join(name), &out, &lenient(), &Silent)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let analysis: omnilife_schemas::records::VideoAnalysis =
            omnilife_schemas::store::read_record(&out.join("analysis.json")).unwrap();
        let seconds = analysis.range.duration_seconds();
        assert!((0.9..2.1).contains(&seconds), "{name}: {seconds}");
    }
}

/// A single frame lasts no time that could be cut into shots.
#[test]
fn a_video_of_one_frame() {
    let temp = tempfile::tempdir().unwrap();
    erp_clip(temp.path(), "one.mp4", &[1], 10, 30);
    ffmpeg(temp.path(), "-i one.mp4 -frames:v 1 -c:v mpeg4 single.mp4");
    let video = temp.path().join("single.mp4");
    let error = curate_video(&video, &temp.path().join("out"), &lenient(), &Silent).unwrap_err();
    assert!(error.failed_checks().is_some(), "{error}");
    assert!(error.to_string().contains("none of its shots"), "{error}");
}

/// Damage in the middle is counted, recorded and a reason for rejection if the criteria require it.
#[test]
fn damage_in_the_middle() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "one.mp4", &[1], 90, 30);
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    for (index, byte) in bytes[middle..middle + 4000].iter_mut().enumerate() {
        *byte = ((index * 37) >> 3) as u8;
    }
    fs::write(&video, bytes).unwrap();
    let out = temp.path().join("out");
    curate_video(&video, &out, &lenient(), &Silent).unwrap();
    let analysis: omnilife_schemas::records::VideoAnalysis =
        omnilife_schemas::store::read_record(&out.join("analysis.json")).unwrap();
    assert!(analysis.damaged_frames > 0);
}

/// A name that is not UTF-8 is one row of the batch, and the rest goes on.
#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_no_utf8() {
    use std::os::unix::ffi::OsStrExt;
    let temp = tempfile::tempdir().unwrap();
    let good = erp_clip(temp.path(), "one.mp4", &[1], 40, 30);
    let strange = temp
        .path()
        .join(std::ffi::OsStr::from_bytes(b"walk-\xff.mp4"));
    fs::copy(&good, &strange).unwrap();
    let bytes = [
        fs::read(&strange).unwrap(),
        vec![0, 0, 0, 8, b'f', b'r', b'e', b'e'],
    ]
    .concat();
    fs::write(&strange, bytes).unwrap();
    let curated = omnilife_curate::curate_dataset(
        &[strange, good],
        &temp.path().join("out"),
        &lenient(),
        &Silent,
    )
    .unwrap();
    assert_eq!(curated.errors.len(), 1);
    assert!(curated.errors[0].1.to_string().contains("not valid UTF-8"));
    assert!(matches!(
        curated.record.videos[1].status,
        omnilife_schemas::records::VideoStatus::Curated { .. }
    ));
}
