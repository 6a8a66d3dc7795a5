//! Slices: the right frames at the right times, spherical metadata, and every second accounted for.

use std::{path::Path, process::Command};

use omnilife_curate::{
    projection,
    slicing::{
        SliceRequest, SliceSettings, SliceSource, shots, slice_segment, slice_video, write_slices,
    },
};
use omnilife_schemas::{
    progress::Silent,
    records::{
        Boundary, BoundaryKind, SegmentOutcome, SliceMethod, Slices, SourceVideo, TimeRange,
        VideoAnalysis,
    },
    testing::Notes,
};
use omnilife_video::{
    Converter, Orientation, Projection, Scaling, VideoReader, ViewVideoWriter, probe,
};
use support::{Clip, erp_direction, shared_data, world_colour};

use crate::support;

const SIZE: (usize, usize) = (128, 64);

/// A clip of one world that yaws, so that every frame differs from every other.
fn yawing(path: &Path, ticks: Vec<i64>) {
    let clip = Clip {
        width: SIZE.0,
        height: SIZE.1,
        ticks,
        index_first: false,
    };
    clip.write(path, |frame, x, y| {
        world_colour(3, erp_direction(x, y, SIZE.0, SIZE.1, 0.05 * frame as f64))
    });
}

/// Timestamps and images of all frames.
fn frames(path: &Path) -> Vec<(f64, Vec<u8>)> {
    let mut reader = VideoReader::open(path).unwrap();
    let mut converter = Converter::new(Scaling::Native);
    let mut all = Vec::new();
    while let Some(frame) = reader.next_frame().unwrap() {
        let image = converter.convert(path, &frame.image).unwrap();
        all.push((frame.time_seconds, image.data));
    }
    all
}

fn mean_difference(a: &[u8], b: &[u8]) -> f64 {
    let sum: f64 = a
        .iter()
        .zip(b)
        .map(|(&a, &b)| f64::from(a.abs_diff(b)))
        .sum();
    sum / a.len() as f64
}

fn range(begin_seconds: f64, end_seconds: f64) -> TimeRange {
    TimeRange::new(begin_seconds, end_seconds)
}

#[test]
fn slices_hold_the_frames_of_their_segment() {
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("clip.mp4");
    // Unsteady, as phones record; the encoder of the tests makes every 12th frame a key frame.
    let ticks: Vec<i64> = (0..60)
        .map(|i| i * 2000 + [0, 300, -200, 500][i as usize % 4])
        .collect();
    yawing(&video, ticks);
    let source = frames(&video);
    let times: Vec<f64> = source.iter().map(|(time, _)| *time).collect();
    let request = |name: &str, first: usize, end: usize| SliceRequest {
        range: range(
            times[first],
            times.get(end).copied().unwrap_or(times[59] + 1.0 / 30.0),
        ),
        path: folder.path().join(name),
        name: name.to_owned(),
    };
    let requests = [
        request("a.mp4", 0, 12),
        request("b.mp4", 12, 20),
        request("c.mp4", 20, 33),
        request("d.mp4", 36, 60),
    ];
    let whole = SliceSource {
        video: &video,
        times: &times,
        orientation: Orientation::default(),
    };
    let notes = Notes::default();
    let files = slice_video(&whole, &requests, SliceSettings { audio: true }, &notes).unwrap();
    // Requested and missing: noted once per slice.
    assert_eq!(notes.take().len(), 4);
    let copied: Vec<bool> = files
        .iter()
        .map(|file| file.method == SliceMethod::Copied)
        .collect();
    assert_eq!(copied, [true, true, false, true]);
    for (file, (request, first)) in files.iter().zip(requests.iter().zip([0, 12, 20, 36])) {
        let slice = frames(&request.path);
        assert_eq!(slice.len() as u64, file.frames, "{}", file.file);
        assert!(!file.audio);
        for (offset, (time, image)) in slice.iter().enumerate() {
            let (source_time, source_image) = &source[first + offset];
            let expected = source_time - request.range.begin_seconds;
            assert!(
                (time - expected).abs() < 2e-5,
                "{} at {expected}: {time}",
                file.file
            );
            let difference = mean_difference(image, source_image);
            let limit = if file.method == SliceMethod::Copied {
                0.0
            } else {
                1.5
            };
            assert!(
                difference <= limit,
                "{} frame {offset}: {difference}",
                file.file
            );
        }
        let probe = probe(&request.path).unwrap();
        assert_eq!(probe.spherical.unwrap().projection, "equirectangular");
        let duration = request.range.duration_seconds();
        assert!(
            (probe.duration_seconds - duration).abs() < 1e-3,
            "{}",
            probe.duration_seconds
        );
    }
}

/// A frame that is missing before the last one does not make that one longer.
#[test]
fn the_last_frame_lasts_as_long_as_most_do() {
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("clip.mp4");
    let ticks = (0..30).filter(|&frame| frame != 28);
    yawing(&video, ticks.map(|frame| frame * 2000).collect());
    let out = folder.path().join("slice.mp4");
    let settings = SliceSettings { audio: false };
    slice_segment(&video, None, None, &out, settings, &Silent).unwrap();
    let seconds = probe(&out).unwrap().duration_seconds;
    assert!((seconds - 1.0).abs() < 1e-3, "{seconds}");
}

#[test]
fn every_second_of_the_source_is_in_a_slice_or_left_out_for_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("clip.mp4");
    yawing(&video, (0..90).map(|i| i * 2000).collect());
    let probed = probe(&video).unwrap();
    let times: Vec<f64> = frames(&video).iter().map(|(time, _)| *time).collect();
    let boundary = |begin: usize, end: usize| Boundary {
        begin_seconds: times[begin],
        end_seconds: times[end],
        kind: BoundaryKind::Gradual,
        score: 1.0,
    };
    let boundaries = [boundary(29, 30), boundary(34, 35), boundary(50, 58)];
    let whole = range(times[0], times[89] + 1.0 / 30.0);
    let shots = shots(&times, whole, &boundaries, 0.5);
    let analysis = VideoAnalysis {
        source: SourceVideo {
            file_name: "clip.mp4".to_owned(),
            sha256: "0".repeat(64),
            bytes: 1,
        },
        range: whole,
        projection: projection::judge(&probed, &[]),
        probe: probed.clone(),
        layout: None,
        overlays: None,
        damaged_frames: 0,
        interlaced_frames: 0,
        repeated_frames: 0,
        longest_repetition_frames: 0,
        frames_out_of_time: 0,
        signals: "signals.parquet".to_owned(),
    };
    let video = SliceSource {
        video: &video,
        times: &times,
        orientation: Orientation::default(),
    };
    let write = |notes: &Notes| -> Slices {
        let settings = Some(SliceSettings { audio: false });
        write_slices(
            folder.path(),
            &analysis,
            &shots,
            &video,
            settings,
            None,
            notes,
        )
        .unwrap()
    };
    let record = write(&Notes::default());
    let mut total = 0.0;
    let mut left_out = 0.0;
    for segment in &record.segments {
        match &segment.outcome {
            SegmentOutcome::Kept { slice, .. } => {
                let file = &slice.as_ref().unwrap().file;
                total += probe(&folder.path().join(file)).unwrap().duration_seconds;
            }
            SegmentOutcome::TooShort
            | SegmentOutcome::LeftOut
            | SegmentOutcome::Rejected { .. }
            | SegmentOutcome::Transition => {
                left_out += segment.range.duration_seconds();
            }
        }
    }
    // The shot of 5 frames, and the 7 frames inside the transition.
    assert!((left_out - 12.0 / 30.0).abs() < 1e-6, "{left_out}");
    let one_frame_per_boundary = boundaries.len() as f64 / 30.0;
    let difference = (total + left_out - probed.duration_seconds).abs();
    assert!(difference < one_frame_per_boundary, "{difference}");
    // And it comes out far better than that.
    assert!(difference < 2e-3, "{difference}");
    let notes = Notes::default();
    assert_eq!(write(&notes), record);
    assert!(notes.take()[0].contains("slices unchanged, skipped"));
}

#[test]
fn rendered_video_is_written_as_it_was_pushed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("views.mp4");
    let (width, height) = SIZE;
    let image = |yaw: f64| -> Vec<u8> {
        (0..width * height)
            .flat_map(|at| {
                let direction = erp_direction(at % width, at / width, width, height, yaw);
                world_colour(2, direction).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
            })
            .collect()
    };
    let size = [width as u32, height as u32];
    let mut writer = ViewVideoWriter::create(&path, size, Projection::Equirectangular).unwrap();
    for frame in 0..10 {
        writer
            .push(&image(0.1 * f64::from(frame)), f64::from(frame) / 25.0)
            .unwrap();
    }
    assert!(
        !path.exists(),
        "nothing stands under the final name before the end"
    );
    writer.finish(0.4).unwrap();
    let read = frames(&path);
    assert_eq!(read.len(), 10);
    for (frame, (time, pixels)) in read.iter().enumerate() {
        assert!((time - frame as f64 / 25.0).abs() < 1e-4);
        let difference = mean_difference(pixels, &image(0.1 * frame as f64));
        // Chroma has half the resolution.
        assert!(difference < 3.0, "{difference}");
    }
    let probe = probe(&path).unwrap();
    assert_eq!(probe.spherical.unwrap().projection, "equirectangular");
    assert!((probe.duration_seconds - 0.4).abs() < 1e-3);
    // A video that is given up leaves nothing.
    let given_up = folder.path().join("b.mp4");
    let mut writer = ViewVideoWriter::create(&given_up, size, Projection::Equirectangular).unwrap();
    writer.push(&image(0.0), 0.0).unwrap();
    assert!(writer.push(&[0; 7], 1.0).is_err());
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert!(ViewVideoWriter::create(&path, [0, 64], Projection::Flat).is_err());
}

#[test]
fn flat_video_of_an_odd_size_is_widened_and_not_spherical() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("views.mp4");
    let mut writer = ViewVideoWriter::create(&path, [31, 21], Projection::Flat).unwrap();
    for frame in 0..3_u8 {
        writer
            .push(&[60 * frame + 40; 31 * 21 * 3], f64::from(frame) / 25.0)
            .unwrap();
    }
    writer.finish(0.12).unwrap();
    let probe = probe(&path).unwrap();
    assert_eq!((probe.width, probe.height), (32, 22));
    assert!(probe.spherical.is_none());
    for (frame, (_, pixels)) in frames(&path).iter().enumerate() {
        let expected = vec![60 * frame as u8 + 40; 32 * 22 * 3];
        assert!(mean_difference(pixels, &expected) < 3.0);
    }
}

/// Real footage with B-frames, sound and a cut inside a group of images.
#[test]
fn real_footage_is_sliced_with_its_sound() {
    for name in ["congo_stereo.mp4", "bikes.mp4", "tunnel.mp4"] {
        let Some(video) = shared_data(name) else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let mut reader = VideoReader::open(&video).unwrap();
        let mut times = Vec::new();
        while let Some(frame) = reader.next_frame().unwrap() {
            times.push(frame.time_seconds);
        }
        let count = times.len();
        let requests: Vec<SliceRequest> = [(0, 40), (count - 60, count)]
            .iter()
            .enumerate()
            .map(|(index, &(first, end))| SliceRequest {
                range: range(
                    times[first],
                    times
                        .get(end)
                        .copied()
                        .unwrap_or(2.0 * times[count - 1] - times[count - 2]),
                ),
                path: folder.path().join(format!("{index}.mp4")),
                name: format!("{index}.mp4"),
            })
            .collect();
        let source = SliceSource {
            video: &video,
            times: &times,
            orientation: Orientation::default(),
        };
        // The slices are read back inside.
        let files =
            slice_video(&source, &requests, SliceSettings { audio: true }, &Silent).unwrap();
        for (file, request) in files.iter().zip(&requests) {
            let duration = probe(&request.path).unwrap().duration_seconds;
            println!("{name} {file:?} {duration}");
            assert!((duration - request.range.duration_seconds()).abs() < 0.05);
            assert_eq!(file.audio, name == "congo_stereo.mp4");
        }
    }
}

/// Runs the program ffmpeg; `false` where it fails.
fn ffmpeg(words: &[&str]) -> bool {
    Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-y"])
        .args(words)
        .status()
        .is_ok_and(|status| status.success())
}

/// Slices 10 to 22 of 30 frames, which has to be encoded, and 0 to 12, which may be copied, and holds
/// both against the source.
fn assert_sliced_like_the_source(video: &Path) {
    let before = probe(video).unwrap();
    let source = frames(video);
    let times: Vec<f64> = source.iter().map(|(time, _)| *time).collect();
    let whole = SliceSource {
        video,
        times: &times,
        orientation: Orientation::of(&before),
    };
    let folder = tempfile::tempdir().unwrap();
    let segments = [(0, 12), (10, 22)];
    let requests = segments.map(|(first, end)| SliceRequest {
        range: range(times[first], times[end]),
        path: folder.path().join(format!("{first}.mp4")),
        name: format!("{first}.mp4"),
    });
    for (request, (first, end)) in requests.iter().zip(segments) {
        let settings = SliceSettings { audio: false };
        let one = std::slice::from_ref(request);
        slice_video(&whole, one, settings, &Silent).unwrap();
        let after = probe(&request.path).unwrap();
        assert_eq!(after.rotation_degrees, before.rotation_degrees);
        assert_eq!(after.bit_depth, before.bit_depth);
        assert_eq!(after.transfer, before.transfer);
        assert_eq!((after.width, after.height), (before.width, before.height));
        assert!(after.spherical.is_some());
        let slice = frames(&request.path);
        assert_eq!(slice.len(), end - first);
        for (offset, (_, image)) in slice.iter().enumerate() {
            let difference = mean_difference(image, &source[first + offset].1);
            assert!(
                difference < 1.5,
                "{} frame {offset}: {difference}",
                request.name
            );
        }
    }
}

#[test]
fn a_turned_video_stays_turned() {
    let folder = tempfile::tempdir().unwrap();
    let upright = folder.path().join("upright.mp4");
    yawing(&upright, (0..30).map(|i| i * 2000).collect());
    let (from, to) = (upright.to_str().unwrap(), folder.path().join("turned.mp4"));
    let out = to.to_str().unwrap();
    // Older versions of the program take the angle as metadata, newer ones as an option.
    let turned = ffmpeg(&[
        "-display_rotation:v:0",
        "-90",
        "-i",
        from,
        "-c",
        "copy",
        out,
    ]) || ffmpeg(&[
        "-i",
        from,
        "-c",
        "copy",
        "-metadata:s:v:0",
        "rotate=90",
        out,
    ]);
    if !turned || probe(&to).unwrap().rotation_degrees == 0.0 {
        omnilife_schemas::testing::skip("this ffmpeg writes no rotation");
        return;
    }
    assert_sliced_like_the_source(&to);
}

#[test]
fn ten_bits_stay_ten_bits() {
    let folder = tempfile::tempdir().unwrap();
    let eight = folder.path().join("eight.mp4");
    yawing(&eight, (0..30).map(|i| i * 2000).collect());
    let deep = folder.path().join("deep.mp4");
    let words = "-c:v libx264 -preset ultrafast -crf 10 -g 12 -bf 0 -pix_fmt yuv420p10le -color_trc \
                 smpte2084 -color_primaries bt2020 -colorspace bt2020nc";
    let mut all = vec!["-i", eight.to_str().unwrap()];
    all.extend(words.split_whitespace());
    all.push(deep.to_str().unwrap());
    if !ffmpeg(&all) {
        omnilife_schemas::testing::skip("this ffmpeg has no 10-bit encoder");
        return;
    }
    let found = probe(&deep).unwrap();
    assert_eq!(
        (found.bit_depth, found.transfer.as_str()),
        (10, "smpte2084")
    );
    assert_sliced_like_the_source(&deep);
}
