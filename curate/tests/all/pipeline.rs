//! The chain on clips that are made here: stages, timestamps, sampling, skipping.

use std::{fs, path::Path};

use omnilife_curate::{
    CurateError, CurateSettings, FrameSelection, curate_video, slicing::SliceSettings,
};
use omnilife_schemas::{
    progress::Silent,
    records::{BoundaryKind, BoundaryLedger, Sampling, Sequence, VideoAnalysis, VideoProjection},
    store,
    testing::Notes,
};
use omnilife_video::{VideoReader, probe};
use support::{Clip, TICK_SECONDS, erp_clip, erp_direction, world_colour};

use crate::support;

fn lenient() -> CurateSettings {
    CurateSettings {
        enforce: false,
        ..CurateSettings::default()
    }
}

fn sequence(out: &Path, name: &str) -> Sequence {
    store::read_record(&out.join(name).join("sequence.json")).unwrap()
}

#[test]
fn timestamps_come_from_the_source_and_an_uneven_rate_is_seen() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("uneven.mp4");
    let mut clip = Clip::steady(256, 128, 45, 30);
    // Begins at 2 s and pauses after the twentieth frame.
    for (index, ticks) in clip.ticks.iter_mut().enumerate() {
        *ticks += 120_000 + if index >= 20 { 7_000 } else { 0 };
    }
    clip.write(&path, |frame, x, y| {
        world_colour(1, erp_direction(x, y, 256, 128, 0.01 * frame as f64))
    });
    let mut reader = VideoReader::open(&path).unwrap();
    let mut times = Vec::new();
    while let Some(frame) = reader.next_frame().unwrap() {
        times.push(frame.time_seconds);
    }
    assert_eq!(times.len(), clip.ticks.len());
    for (time, ticks) in times.iter().zip(&clip.ticks) {
        assert!(
            (time - *ticks as f64 * TICK_SECONDS).abs() < 1e-4,
            "{time} for {ticks}"
        );
    }
    let out = temp.path().join("out");
    curate_video(&path, &out, &lenient(), &Silent).unwrap();
    let sequence = sequence(&out, "seq-000");
    assert_eq!(sequence.probe.variable_frame_rate, Some(true));
    assert_eq!(sequence.probe.decoded_frames, Some(45));
    let sampled: Vec<f64> = sequence
        .frames
        .entries
        .iter()
        .map(|e| e.time_seconds)
        .collect();
    assert_eq!(sampled, times);
}

/// Blurs four of every five frames.
#[test]
fn the_sharpest_frames_are_taken_on_request_with_their_reason() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("walk.mp4");
    Clip::steady(256, 128, 40, 25).write(&video, |frame, x, y| {
        let [a, b, c] = erp_direction(x, y, 256, 128, 0.008 * frame as f64);
        let detail = match frame % 5 {
            1 => 0.08 * (40.0 * a).sin() * (37.0 * b).cos() * (35.0 * c).cos(),
            _ => 0.0,
        };
        world_colour(1, [a, b, c]).map(|value| value + detail)
    });
    let out = temp.path().join("walk");
    let settings = CurateSettings {
        accept: Some(VideoProjection::Erp),
        sampling: Sampling::MaxFrames(8),
        ..lenient()
    };
    let times = |sequence: &Sequence| -> Vec<u32> {
        let entries = sequence.frames.entries.iter();
        entries
            .map(|entry| (25.0 * entry.time_seconds).round() as u32)
            .collect()
    };
    curate_video(&video, &out, &settings, &Silent).unwrap();
    let even = sequence(&out, "seq-000");
    assert_eq!(times(&even), [0, 5, 10, 15, 20, 25, 30, 35]);
    assert_eq!(even.frames.sharpest, None);

    let settings = CurateSettings {
        select: FrameSelection::Sharp,
        ..settings
    };
    let notes = Notes::default();
    curate_video(&video, &out, &settings, &notes).unwrap();
    let sharp = sequence(&out, "seq-000");
    assert_eq!(times(&sharp), [1, 6, 11, 16, 21, 26, 31, 36]);
    let reasons = &sharp.frames.sharpest.as_ref().unwrap().frames;
    for (reason, entry) in reasons.iter().zip(&even.frames.entries) {
        assert!(reason.sharpness > reason.even_sharpness, "{reason:?}");
        assert_eq!(reason.even_seconds, entry.time_seconds);
    }
    assert!(!notes.take().join("\n").contains("skipped"));
    curate_video(&video, &out, &settings, &notes).unwrap();
    assert!(
        notes
            .take()
            .join("\n")
            .contains("analysis unchanged, skipped")
    );
    assert_eq!(sequence(&out, "seq-000"), sharp);
}

#[test]
fn a_cut_makes_two_sequences_and_unchanged_stages_are_skipped() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1, 3], 60, 30);
    let out = temp.path().join("walk");
    let notes = Notes::default();
    let settings = CurateSettings {
        sampling: Sampling::MaxFrames(20),
        ..lenient()
    };
    let names = curate_video(&video, &out, &settings, &notes).unwrap();
    assert_eq!(names, ["seq-000", "seq-001"]);
    let said = notes.take().join("\n");
    assert!(
        said.contains("would not be admitted by omnilife360"),
        "{said}"
    );

    let ledger: BoundaryLedger = store::read_record(&out.join("boundaries.json")).unwrap();
    assert_eq!(ledger.boundaries.len(), 1);
    let cut = &ledger.boundaries[0];
    assert_eq!(cut.kind, BoundaryKind::Cut);
    assert!((cut.end_seconds - 2.0).abs() < 1e-3 && (cut.begin_seconds - 59.0 / 30.0).abs() < 1e-3);
    let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
    assert_eq!(analysis.projection.projection, VideoProjection::Erp);
    assert_eq!(analysis.probe.variable_frame_rate, Some(false));
    assert_eq!(analysis.damaged_frames, 0);

    let second = sequence(&out, "seq-001");
    assert_eq!(second.id, "walk/seq-001");
    assert_eq!((second.frames.width, second.frames.height), (256, 128));
    assert_eq!(second.frames.resampling, "none");
    assert_eq!(second.frames.entries.len(), 20);
    assert!((second.frames.entries[1].time_seconds - 2.1).abs() < 1e-3);
    let files = fs::read_dir(out.join("seq-001/frames")).unwrap().count();
    assert_eq!(files, 20);

    // Nothing has changed: both stages say so, and no file is touched.
    let image = out.join("seq-001/frames/000007.png");
    let written = fs::metadata(&image).unwrap().modified().unwrap();
    assert_eq!(
        curate_video(&video, &out, &settings, &notes).unwrap(),
        names
    );
    let said = notes.take().join("\n");
    assert_eq!(said.matches("unchanged, skipped").count(), 2, "{said}");
    assert_eq!(fs::metadata(&image).unwrap().modified().unwrap(), written);

    // Another sampling extracts again and does not analyse again.
    let denser = CurateSettings {
        sampling: Sampling::FramesPerSecond(15.0),
        ..settings.clone()
    };
    curate_video(&video, &out, &denser, &notes).unwrap();
    let said = notes.take().join("\n");
    assert_eq!(said.matches("unchanged, skipped").count(), 1, "{said}");
    assert_eq!(sequence(&out, "seq-001").frames.entries.len(), 30);

    // A lost frame is made again.
    fs::remove_file(&image).unwrap();
    curate_video(&video, &out, &denser, &notes).unwrap();
    assert!(image.exists());
    let hidden = fs::read_dir(&out)
        .unwrap()
        .filter(|entry| {
            entry
                .as_ref()
                .unwrap()
                .file_name()
                .to_string_lossy()
                .starts_with(".tmp")
        })
        .count();
    assert_eq!(hidden, 0);
}

/// Other criteria and another file name rewrite the record and touch no frame; other frames set
/// aside what was made from the old ones.
#[test]
fn what_was_made_from_frames_is_never_deleted() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1], 40, 20);
    let out = temp.path().join("walk");
    curate_video(&video, &out, &lenient(), &Silent).unwrap();
    let scores = out.join("seq-000/per-scene/result.json");
    fs::create_dir(out.join("seq-000/per-scene")).unwrap();
    fs::write(&scores, "hours of work").unwrap();
    let image = out.join("seq-000/frames/000000.png");
    let written = fs::metadata(&image).unwrap().modified().unwrap();

    let renamed = temp.path().join("stroll.mp4");
    fs::rename(&video, &renamed).unwrap();
    let settings = CurateSettings {
        profile: "none".to_owned(),
        accept: Some(VideoProjection::Erp),
        ..lenient()
    };
    curate_video(&renamed, &out, &settings, &Silent).unwrap();
    let record = sequence(&out, "seq-000");
    assert_eq!(record.source.file_name, "stroll.mp4");
    assert_eq!(record.admission.profile, "none");
    let analysis: VideoAnalysis = store::read_record(&out.join("analysis.json")).unwrap();
    assert_eq!(analysis.source.file_name, "stroll.mp4");
    assert_eq!(fs::metadata(&image).unwrap().modified().unwrap(), written);
    assert!(scores.exists());

    let fewer = CurateSettings {
        sampling: Sampling::MaxFrames(5),
        ..settings.clone()
    };
    let notes = Notes::default();
    // Leftovers of a killed process are removed without a note.
    let own = store::temporary_beside(&out.join("sequences"));
    let own = own.to_str().unwrap();
    // An id that no process has.
    let abandoned = own.replacen(&format!("-{}-", std::process::id()), "-8388608-", 1);
    let abandoned = Path::new(&abandoned);
    fs::create_dir(abandoned).unwrap();
    curate_video(&renamed, &out, &fewer, &notes).unwrap();
    let said = notes.take().join("|");
    assert!(
        said.contains("set aside") && said.contains("per-scene"),
        "{said}"
    );
    let kept = fs::read(out.join(".superseded/seq-000-1/per-scene/result.json")).unwrap();
    assert_eq!(kept, b"hours of work");
    assert_eq!(sequence(&out, "seq-000").frames.entries.len(), 5);
    assert!(!out.join("seq-000/per-scene").exists() && !abandoned.exists());

    // Nothing but frames: replaced in place.
    curate_video(&renamed, &out, &settings, &Silent).unwrap();
    assert_eq!(fs::read_dir(out.join(".superseded")).unwrap().count(), 1);
    assert_eq!(sequence(&out, "seq-000").frames.entries.len(), 40);
}

/// A video that newer criteria exclude leaves the same as if they had always excluded it; work of others is set aside.
#[test]
fn a_video_that_is_kept_out_later_takes_its_sequences_back() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1, 3], 40, 20);
    let out = temp.path().join("walk");
    let sliced = CurateSettings {
        slices: Some(SliceSettings { audio: false }),
        ..lenient()
    };
    curate_video(&video, &out, &sliced, &Silent).unwrap();
    assert!(out.join("slices/seq-001.mp4").exists());
    fs::write(out.join("seq-001/scene.json"), "poses").unwrap();
    let strict = CurateSettings {
        profile: "omnilife360".to_owned(),
        enforce: true,
        ..sliced.clone()
    };
    let error = curate_video(&video, &out, &strict, &Silent).unwrap_err();
    assert!(error.failed_checks().is_some(), "{error}");
    assert_eq!(
        store::names_in(&out).unwrap(),
        [
            ".done",
            ".superseded",
            "analysis.json",
            "samples.parquet",
            "signals.parquet",
            "signature.parquet"
        ]
    );
    let kept = fs::read(out.join(".superseded/seq-001-1/scene.json")).unwrap();
    assert_eq!(kept, b"poses");
    assert!(!out.join(".superseded/seq-000-1").exists());

    // Another video's folder is not touched.
    let other = erp_clip(temp.path(), "other.mp4", &[2], 40, 20);
    curate_video(&video, &out, &sliced, &Silent).unwrap();
    curate_video(&other, &out, &strict, &Silent).unwrap_err();
    assert!(out.join("seq-000/sequence.json").exists());
}

/// A sequence that is no longer cut goes; the ones around it stay as they are.
#[test]
fn sequences_that_are_no_longer_cut_make_way() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1, 3], 40, 20);
    let out = temp.path().join("walk");
    curate_video(&video, &out, &lenient(), &Silent).unwrap();
    fs::create_dir(out.join("seq-1000")).unwrap();
    fs::write(out.join("seq-1000/notes.txt"), "mine").unwrap();
    fs::create_dir_all(out.join("seq-002/frames")).unwrap();
    let names = curate_video(&video, &out, &lenient(), &Silent).unwrap();
    assert_eq!(names, ["seq-000", "seq-001"]);
    assert!(!out.join("seq-002").exists() && !out.join("seq-1000").exists());
    assert!(out.join(".superseded/seq-1000-1/notes.txt").exists());
}

#[test]
fn short_shots_are_recorded_as_dropped() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("short.mp4");
    Clip::steady(256, 128, 90, 30).write(&video, |frame, x, y| {
        let world = [1, 3, 2][usize::from(frame >= 45) + usize::from(frame >= 60)];
        world_colour(world, erp_direction(x, y, 256, 128, 0.01 * frame as f64))
    });
    let out = temp.path().join("short");
    let names = curate_video(&video, &out, &lenient(), &Silent).unwrap();
    assert_eq!(names.len(), 2);
    let ledger: BoundaryLedger = store::read_record(&out.join("boundaries.json")).unwrap();
    assert_eq!(ledger.boundaries.len(), 2);
    assert_eq!(ledger.dropped.len(), 1);
    assert!((ledger.dropped[0].duration_seconds() - 0.5).abs() < 1e-3);

    let strict = CurateSettings {
        minimum_shot_seconds: 5.0,
        ..lenient()
    };
    let error = curate_video(&video, &out, &strict, &Silent).unwrap_err();
    assert!(error.failed_checks().is_some(), "{error}");
}

/// The squeezed image is widened to 2:1, and nothing is turned or mirrored on the way.
#[test]
fn squeezed_frames_come_out_wide_upright_and_unmirrored() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("squeezed.mp4");
    let (width, height) = (320, 180);
    Clip::steady(width, height, 40, 25).write(&video, |_, x, y| {
        world_colour(2, erp_direction(x, y, width, height, 0.0))
    });
    let out = temp.path().join("squeezed");
    curate_video(&video, &out, &lenient(), &Silent).unwrap();
    let sequence = sequence(&out, "seq-000");
    assert_eq!(sequence.projection.projection, VideoProjection::ErpSqueezed);
    assert_eq!((sequence.frames.width, sequence.frames.height), (320, 160));
    assert_eq!(sequence.frames.resampling, "area averaging from 320x180");
    let image = omnilife_schemas::RgbImage::read(&out.join("seq-000/frames/000000.png")).unwrap();
    assert_eq!((image.width, image.height), (320, 160));
    let mut worst = 0.0_f64;
    let mut sum = 0.0;
    for y in 0..160 {
        for x in 0..320 {
            let expected = world_colour(2, erp_direction(x, y, 320, 160, 0.0));
            for (channel, level) in expected.iter().enumerate() {
                let found = f64::from(image.data[(y * 320 + x) * 3 + channel]);
                let error = (found - level.clamp(0.0, 1.0)).abs();
                worst = worst.max(error);
                sum += error;
            }
        }
    }
    // Compression and chroma at half resolution leave a percent or two.
    assert!(
        sum / (160.0 * 320.0 * 3.0) < 0.02,
        "{}",
        sum / (160.0 * 320.0 * 3.0)
    );
    assert!(worst < 0.25, "{worst}");
}

#[test]
fn enforced_criteria_and_wrong_projections_reject_with_a_hint() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "small.mp4", &[1], 40, 30);
    let out = temp.path().join("small");
    let error = curate_video(&video, &out, &CurateSettings::default(), &Silent).unwrap_err();
    let message = error.to_string();
    assert!(
        error.failed_checks().is_some() && message.contains("resolution is 256x128"),
        "{message}"
    );
    assert!(
        !out.exists(),
        "rejected by its header, before anything is written"
    );

    let flat = temp.path().join("flat.mp4");
    Clip::steady(320, 180, 40, 30).write(&flat, |frame, x, y| {
        let (u, v) = (x as f64 / 160.0 - 1.0, y as f64 / 160.0 - 0.56);
        world_colour(1, [1.7 * u, 2.3 * v, 0.3 * u * v + 0.01 * frame as f64])
    });
    let error = curate_video(&flat, &temp.path().join("flat"), &lenient(), &Silent).unwrap_err();
    assert!(matches!(error, CurateError::Rejected { .. }), "{error}");
    assert!(
        error.to_string().contains("rectilinear; if it is"),
        "{error}"
    );
    let accepting = CurateSettings {
        accept: Some(VideoProjection::Erp),
        ..lenient()
    };
    curate_video(&flat, &temp.path().join("flat"), &accepting, &Silent).unwrap();
    let projection = sequence(&temp.path().join("flat"), "seq-000").projection;
    assert_eq!(projection.projection, VideoProjection::Erp);
    assert_eq!(projection.overridden, Some(VideoProjection::Rectilinear));
    assert_eq!(probe(&flat).unwrap().decoded_frames, None);
}

/// The sample in the repository, stored as it was rendered.
#[test]
fn the_sample_clip_is_one_erp_sequence() {
    let clip = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/street/street.mp4");
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("street");
    assert_eq!(
        curate_video(&clip, &out, &lenient(), &Silent).unwrap(),
        ["seq-000"]
    );
    let sequence = sequence(&out, "seq-000");
    assert_eq!(
        sequence.projection.projection,
        VideoProjection::Erp,
        "{:#?}",
        sequence.projection
    );
    assert_eq!(sequence.frames.entries.len(), 60);
}
