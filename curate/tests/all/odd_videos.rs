//! Videos that hold something else than one upright image at the rate that their header states.

use std::{fs, path::Path, process::Command};

use omnilife_curate::{CurateSettings, analysis::timed_probe, curate_video};
use omnilife_schemas::{
    Classified, ErrorKind,
    progress::Silent,
    records::{Sampling, Sequence, VideoAnalysis, VideoProjection},
    store,
    testing::Notes,
};
use omnilife_video::{
    Orientation, VideoError, probe, writing::spherical_boxes::mark_equirectangular,
};
use support::{Clip, erp_clip, erp_direction, world_colour};

use crate::support;

fn lenient() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        enforce: false,
        ..CurateSettings::default()
    }
}

/// Puts the streams of some videos into one.
fn joined(inputs: &[&Path], options: &[&str], out: &Path) {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-y"]);
    for input in inputs {
        command.arg("-i").arg(input);
    }
    for number in 0..inputs.len() {
        command.args(["-map".to_owned(), format!("{number}:v")]);
    }
    let ended = command.args(["-c", "copy"]).args(options).arg(out).status();
    assert!(ended.unwrap().success());
}

fn clip(folder: &Path, name: &str, width: usize, height: usize) -> std::path::PathBuf {
    let path = folder.join(name);
    Clip::steady(width, height, 20, 10).write(&path, |frame, x, y| {
        world_colour(1, erp_direction(x, y, width, height, 0.02 * frame as f64))
    });
    path
}

#[test]
fn a_stream_is_no_sphere_where_another_one_has_its_other_half() {
    let temp = tempfile::tempdir().unwrap();
    let [a, b] = ["a.mp4", "b.mp4"].map(|name| clip(temp.path(), name, 192, 64));
    let both = temp.path().join("GS010001.360");
    joined(&[&a, &b], &["-f", "mp4"], &both);
    for layout in [
        None,
        Some("eac"),
        Some("dual-fisheye:190"),
        Some("dual-fisheye"),
    ] {
        let settings = CurateSettings {
            layout: layout.map(|layout| layout.parse().unwrap()),
            ..lenient()
        };
        let out = temp.path().join("out");
        let error = curate_video(&both, &out, &settings, &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        assert!(
            error.to_string().contains("2 video streams of 192x64"),
            "{error}"
        );
        assert!(!out.exists());
    }
    // A preview of another size and a cover are not halves.
    let preview = clip(temp.path(), "preview.mp4", 96, 32);
    let with_preview = temp.path().join("with-preview.mp4");
    joined(&[&a, &preview], &[], &with_preview);
    assert_eq!(probe(&with_preview).unwrap().width, 192);
    let cover = temp.path().join("cover.png");
    image_of(&a, &cover);
    let with_cover = temp.path().join("with-cover.mp4");
    joined(
        &[&a, &cover],
        &["-disposition:v:1", "attached_pic"],
        &with_cover,
    );
    assert_eq!(probe(&with_cover).unwrap().width, 192);
}

/// Players show the stream that is marked as the default, and so does FFmpeg's choice.
#[test]
fn a_preview_that_is_the_default_is_not_taken_for_the_video() {
    let temp = tempfile::tempdir().unwrap();
    let large = clip(temp.path(), "large.mp4", 192, 96);
    let small = clip(temp.path(), "small.mp4", 96, 48);
    for (first, second, expected) in [(&large, &small, Some(192)), (&small, &large, None)] {
        let both = temp.path().join("both.mkv");
        let marks = ["-disposition:v:0", "default", "-disposition:v:1", "0"];
        joined(&[first, second], &marks, &both);
        match (probe(&both), expected) {
            (Ok(found), Some(width)) => assert_eq!(found.width, width),
            (Err(error @ VideoError::Unusable { .. }), None) => {
                let message = error.to_string();
                for part in ["0:0, of 96x48", "0:1 of 192x96"] {
                    assert!(message.contains(part), "{message}");
                }
            }
            (found, expected) => panic!("{found:?}, and not {expected:?}"),
        }
    }
}

/// Runs `ffmpeg` with these words, in a folder.
fn ffmpeg(folder: &Path, words: &str) {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-y"]);
    let ended = command.args(words.split(' ')).current_dir(folder).status();
    assert!(ended.unwrap().success(), "{words}");
}

/// Matroska states one duration for the whole file, which counts from 0 to the end of its last stream.
#[test]
fn longer_sound_and_a_late_start_are_no_truncation() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 20, 10);
    let sound = "-f lavfi -t 6 -i sine=440 -map 0:v -map 1:a -c:v copy -c:a pcm_s16le";
    ffmpeg(folder, &format!("-i a.mp4 {sound} sound.mkv"));
    ffmpeg(folder, "-i a.mp4 -c copy -output_ts_offset 7 late.mkv");
    for (name, stated) in [("sound.mkv", 6.0), ("late.mkv", 9.0)] {
        let video = folder.join(name);
        let header = probe(&video).unwrap().duration_seconds;
        assert!((header - stated).abs() < 0.3, "{name}: {header}");
        let out = folder.join("out").join(name);
        curate_video(&video, &out, &lenient(), &Silent).unwrap();
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        let found = analysis.probe.duration_seconds;
        assert!((found - 2.0).abs() < 0.11, "{name}: {found}");
        // Cut off, both lack what they state.
        let bytes = fs::read(&video).unwrap();
        let cut = folder.join(format!("cut-{name}"));
        fs::write(&cut, &bytes[..bytes.len() * 6 / 10]).unwrap();
        let out = folder.join("cut-out").join(name);
        let error = curate_video(&cut, &out, &lenient(), &Silent).unwrap_err();
        assert!(error.to_string().contains("truncated"), "{error}");
    }
}

/// An injector that was told of VR180 by mistake: a whole sphere in frames of 2:1.
#[test]
fn a_whole_sphere_that_is_stated_as_a_half_is_taken_by_its_pixels() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "a.mp4", &[1], 20, 10);
    mark_equirectangular(&video, Orientation::default()).unwrap();
    let mut bytes = fs::read(&video).unwrap();
    // Behind the name come version and flags, then the omissions at the top, the bottom, on the left and on the right.
    let at = bytes.windows(4).position(|word| word == b"equi").unwrap() + 8;
    let quarters = [0_u32, 0, 1 << 30, 1 << 30].map(u32::to_be_bytes);
    bytes[at..at + 16].copy_from_slice(quarters.as_flattened());
    fs::write(&video, bytes).unwrap();
    assert!(probe(&video).unwrap().spherical.unwrap().is_front_half);
    for (folder, accept) in [("found", None), ("said", Some(VideoProjection::Erp))] {
        let settings = CurateSettings {
            accept,
            ..lenient()
        };
        let (out, notes) = (temp.path().join(folder), Notes::default());
        curate_video(&video, &out, &settings, &notes).unwrap();
        let sequence: Sequence = store::read_record(&out.join("seq-000/sequence.json")).unwrap();
        assert_eq!(sequence.frames.converted_from, None);
        let notes = notes.take();
        let is_told = notes.iter().any(|line| line.contains("the pixels say erp"));
        assert!(is_told || accept.is_some(), "{notes:?}");
    }
}

/// FFmpeg's scaler would take them for those of another matrix.
#[test]
fn colours_of_a_matrix_that_is_not_converted_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 20, 10);
    for (matrix, refused) in [
        ("bt470bg", None),
        ("ycgco", Some("YCgCo")),
        ("ictcp", Some("ICtCp")),
        ("smpte240m", None),
        ("fcc", None),
        ("bt2020c", Some("constant luminance")),
    ] {
        let video = folder.join(format!("{matrix}.mkv"));
        let words = format!("-i a.mp4 -c:v mpeg4 -q:v 2 -colorspace {matrix} {matrix}.mkv");
        ffmpeg(folder, &words);
        let found = curate_video(&video, &folder.join(matrix), &lenient(), &Silent);
        match (found, refused) {
            (Ok(_), None) => {}
            (Err(error), Some(name)) => {
                assert_eq!(error.error_kind(), ErrorKind::User);
                assert!(error.to_string().contains(name), "{error}");
            }
            (found, _) => panic!("{matrix}: {found:?}"),
        }
    }
}

#[test]
fn an_assumed_matrix_of_colours_is_recorded_and_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 20, 10);
    let large = "-vf scale=1280:640";
    for (name, options, expected) in [
        ("small.mkv", "-c:v mpeg4 -q:v 2", Some("BT.601")),
        (
            "large.mkv",
            &format!("{large} -c:v mpeg4 -q:v 2"),
            Some("BT.709"),
        ),
        ("stated.mkv", "-c:v mpeg4 -q:v 2 -colorspace bt470bg", None),
        ("rgb.mkv", "-c:v ffv1 -pix_fmt gbrp", None),
        ("grey.mkv", "-c:v ffv1 -pix_fmt gray", None),
    ] {
        ffmpeg(folder, &format!("-i a.mp4 {options} {name}"));
        let (out, notes) = (folder.join("out").join(name), Notes::default());
        curate_video(&folder.join(name), &out, &lenient(), &notes).unwrap();
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        assert_eq!(analysis.probe.assumed_matrix.as_deref(), expected, "{name}");
        let notes = notes.take();
        let is_told = notes
            .iter()
            .any(|line| line.contains("matrix of its colours"));
        assert_eq!(is_told, expected.is_some(), "{notes:?}");
    }
}

#[test]
fn primaries_wider_than_those_of_the_frames_are_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 20, 10);
    for (primaries, is_wide) in [("bt709", false), ("bt2020", true), ("smpte432", true)] {
        let video = folder.join(format!("{primaries}.mkv"));
        let words =
            format!("-i a.mp4 -c:v mpeg4 -q:v 2 -color_primaries {primaries} {primaries}.mkv");
        ffmpeg(folder, &words);
        let (out, notes) = (folder.join(primaries), Notes::default());
        curate_video(&video, &out, &lenient(), &notes).unwrap();
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        assert_eq!(analysis.probe.primaries, primaries);
        let notes = notes.take();
        let is_told = notes.iter().any(|line| line.contains("primaries"));
        assert_eq!(is_told, is_wide, "{notes:?}");
    }
}

/// A camcorder's fields, and one frame a moment in the same coding.
#[test]
fn interlaced_frames_are_counted_and_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 40, 20);
    let fields = "-vf tinterlace=interleave_top -flags +ildct+ilme -top 1";
    for (name, options, expected) in [("fields.mkv", fields, 20), ("frames.mkv", "-g 10", 0)] {
        ffmpeg(
            folder,
            &format!("-i a.mp4 {options} -c:v mpeg2video -q:v 2 {name}"),
        );
        let (out, notes) = (folder.join("out").join(name), Notes::default());
        curate_video(&folder.join(name), &out, &lenient(), &notes).unwrap();
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        assert_eq!(analysis.interlaced_frames, expected, "{name}");
        let notes = notes.take();
        let is_told = notes.iter().any(|line| line.contains("interlaced"));
        assert_eq!(is_told, expected > 0, "{notes:?}");
    }
}

/// Ten pictures a second, as they are and stored at thirty.
#[test]
fn repeated_frames_are_counted_and_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 60, 10);
    ffmpeg(
        folder,
        "-i a.mp4 -vf fps=30 -c:v libx264 -crf 20 thrice.mp4",
    );
    for (name, rate, expected) in [("a.mp4", 10.0, 0..=0), ("thrice.mp4", 40.0, 110..=120)] {
        let (out, notes) = (folder.join("out").join(name), Notes::default());
        let settings = CurateSettings {
            sampling: Sampling::FramesPerSecond(rate),
            ..lenient()
        };
        curate_video(&folder.join(name), &out, &settings, &notes).unwrap();
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        let repeated = analysis.repeated_frames;
        assert!(expected.contains(&repeated), "{name}: {repeated}");
        let notes = notes.take();
        let count = |words: &str| notes.iter().filter(|line| line.contains(words)).count();
        assert_eq!(
            count("repeat the picture"),
            usize::from(repeated > 0),
            "{notes:?}"
        );
        assert_eq!(
            count("40 frames a second"),
            usize::from(rate > 30.0),
            "{notes:?}"
        );
    }
}

/// Two files joined end to end, a picture that stands still, and a hole of three seconds.
#[test]
fn frames_out_of_time_frozen_ones_and_gaps_are_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    erp_clip(folder, "a.mp4", &[1], 40, 10);
    ffmpeg(folder, "-i a.mp4 -c:v libx264 -crf 20 a.ts");
    let part = fs::read(folder.join("a.ts")).unwrap();
    fs::write(folder.join("joined.ts"), [part.clone(), part].concat()).unwrap();
    ffmpeg(
        folder,
        "-i a.mp4 -vf loop=loop=15:size=1:start=20,setpts=N/10/TB -c:v ffv1 still.mkv",
    );
    ffmpeg(
        folder,
        "-i a.mp4 -vf setpts='(N+if(gte(N\\,20)\\,30\\,0))/10/TB' -fps_mode passthrough -c:v libx264 hole.mp4",
    );
    for (name, words) in [
        ("joined.ts", "are left out: 40"),
        ("still.mkv", "15 in a row"),
        ("hole.mp4", "without a frame is 3.1 s"),
        ("a.mp4", ""),
    ] {
        let (out, notes) = (folder.join("out").join(name), Notes::default());
        curate_video(&folder.join(name), &out, &lenient(), &notes).unwrap();
        let notes = notes.take();
        for other in ["are left out: 40", "in a row", "without a frame"] {
            let is_told = notes.iter().any(|line| line.contains(other));
            let is_expected = words.contains(other) || other.contains(words) && !words.is_empty();
            assert_eq!(is_told, is_expected, "{name}, {other}: {notes:?}");
        }
        let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
        assert_eq!(analysis.damaged_frames, 0, "{name}");
        assert_eq!(analysis.frames_out_of_time > 0, name == "joined.ts");
        assert_eq!(
            analysis.longest_repetition_frames,
            if name == "still.mkv" { 15 } else { 0 }
        );
    }
}

/// The first frame of a video.
fn image_of(video: &Path, out: &Path) {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-y", "-i"]);
    let ended = command
        .arg(video)
        .args(["-frames:v", "1"])
        .arg(out)
        .status();
    assert!(ended.unwrap().success());
}

/// A copy of an mp4 whose track header has this matrix: a, b, c and d, in 16.16.
fn with_matrix(video: &Path, [a, b, c, d]: [i32; 4], out: &Path) {
    let mut bytes = fs::read(video).unwrap();
    let header = bytes.windows(4).position(|word| word == b"tkhd").unwrap();
    for (place, value) in [(0, a), (4, b), (12, c), (16, d)] {
        let at = header + 44 + place;
        bytes[at..at + 4].copy_from_slice(&(value << 16).to_be_bytes());
    }
    fs::write(out, bytes).unwrap();
}

#[test]
fn a_matrix_that_mirrors_is_no_turn() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "a.mp4", &[1], 10, 10);
    let changed = temp.path().join("changed.mp4");
    for (matrix, degrees) in [
        ([1, 0, 0, 1], Some(0.0)),
        ([-1, 0, 0, -1], Some(180.0)),
        ([0, 1, -1, 0], Some(90.0)),
        ([-1, 0, 0, 1], None),
        ([1, 0, 0, -1], None),
        ([0, 1, 1, 0], None),
    ] {
        with_matrix(&video, matrix, &changed);
        match (probe(&changed), degrees) {
            (Ok(found), Some(degrees)) => assert_eq!(found.rotation_degrees, degrees),
            (Err(error @ VideoError::Unusable { .. }), None) => {
                assert!(error.to_string().contains("mirrors"), "{error}");
            }
            (found, expected) => panic!("{matrix:?}: {found:?}, and not {expected:?}"),
        }
    }
}

/// An editor or phone that marks a panorama for display on its side; neither a cube nor a fisheye is the cause.
#[test]
fn a_panorama_on_its_side_is_refused_for_its_turn() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "a.mp4", &[1], 20, 10);
    let turned = temp.path().join("turned.mp4");
    with_matrix(&video, [0, 1, -1, 0], &turned);
    let out = temp.path().join("out");
    let error = curate_video(&turned, &out, &lenient(), &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().contains("quarter turn"), "{error}");
}

/// Criteria that ask for a frame rate alone.
fn asking_for(rate: f64, folder: &Path) -> CurateSettings {
    let file = folder.join("rate.toml");
    let text = format!("name = \"rate\"\n[thresholds]\nleast_frames_per_second = {rate:.3}\n");
    fs::write(&file, text).unwrap();
    CurateSettings {
        profile: file.display().to_string(),
        enforce: true,
        accept: Some(VideoProjection::Erp),
        ..CurateSettings::default()
    }
}

#[test]
fn time_stamps_decide_on_the_frame_rate_and_not_the_header() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("late.mp4");
    let mut clip = Clip::steady(256, 128, 60, 30);
    // All but the first come later, and the packet of the last one claims as much time as that of the first.
    for ticks in &mut clip.ticks[1..] {
        *ticks += 10_000;
    }
    clip.write(&video, |frame, x, y| {
        world_colour(1, erp_direction(x, y, 256, 128, 0.01 * frame as f64))
    });
    let stamped = 59.0 / (59.0 / 30.0 + 10_000.0 / 60_000.0);
    let header = probe(&video).unwrap();
    assert!(header.frames_per_second < stamped - 1.0, "{header:?}");
    let timed = timed_probe(&video).unwrap();
    assert!(
        (timed.frames_per_second - stamped).abs() < 0.01,
        "{timed:?}"
    );
    assert_eq!(timed.variable_frame_rate, Some(true));
    let curated = |rate: f64| {
        let settings = asking_for(rate, temp.path());
        curate_video(&video, &temp.path().join("out"), &settings, &Silent)
    };
    curated(stamped - 0.05).unwrap();
    let error = curated(stamped + 0.05).unwrap_err();
    let failed = error.failed_checks().unwrap();
    assert_eq!(failed.len(), 1);
    assert_eq!(failed[0].check, "frame-rate");
    let found: f64 = failed[0].value.split(' ').next().unwrap().parse().unwrap();
    assert!((found - stamped).abs() < 0.01, "{failed:?}");
}
