//! Videos with impossible headers: each is read or refused in one line, and none ends the program.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{CurateSettings, analysis, boundaries, curate_video};
use omnilife_schemas::{
    progress::Silent,
    records::{Sampling, Sequence, VideoProjection},
    store,
};
use omnilife_video::{Converter, Scaling, VideoReader, probe};
use support::erp_clip;

use crate::support;

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

/// A Matroska file in which one of the elements of the colour description is a number that is no
/// value of FFmpeg's enum.
fn with_colour(folder: &Path, element: [u8; 2], name: &str) -> PathBuf {
    let plain = folder.join("plain.mkv");
    if !plain.exists() {
        ffmpeg(
            folder,
            "-f lavfi -i testsrc2=s=256x128:d=2:r=10 -c:v mpeg4 -color_trc bt709 \
             -color_primaries bt709 -colorspace bt709 plain.mkv",
        );
    }
    let bytes = fs::read(&plain).unwrap();
    let begin = bytes
        .windows(4)
        .position(|window| window == [0x55, 0xba, 0x81, 0x01])
        .unwrap();
    assert_eq!(bytes[begin + 4..begin + 6], [0x55, 0xb1]);
    // Twelve bytes: three elements of four make one of ten and a void of two.
    let mut changed = bytes[..begin].to_vec();
    changed.extend_from_slice(&element);
    changed.push(0x87);
    changed.extend_from_slice(&0x7fff_ffff_u64.to_be_bytes()[1..]);
    changed.extend_from_slice(&[0xec, 0x80]);
    changed.extend_from_slice(&bytes[begin + 12..]);
    assert_eq!(changed.len(), bytes.len());
    let path = folder.join(name);
    fs::write(&path, changed).unwrap();
    path
}

fn analysed(video: &Path) -> analysis::Analysis {
    let detector = boundaries::detector(boundaries::DEFAULT_DETECTOR, video).unwrap();
    analysis::analyse(video, detector, None, &Silent)
        .unwrap_or_else(|error| panic!("{}: {error}", video.display()))
}

#[test]
fn colours_that_are_no_value_of_the_enum_are_unknown() {
    let temp = tempfile::tempdir().unwrap();
    let transfer = with_colour(temp.path(), [0x55, 0xba], "transfer.mkv");
    assert_eq!(probe(&transfer).unwrap().transfer, "unknown");
    let matrix = with_colour(temp.path(), [0x55, 0xb1], "matrix.mkv");
    let primaries = with_colour(temp.path(), [0x55, 0xbb], "primaries.mkv");
    for video in [transfer, matrix, primaries] {
        assert_eq!(analysed(&video).probe.decoded_frames, Some(20));
    }
}

/// An uncompressed AVI file whose frames are stored from their bottom up, as its extra data says.
/// Row `y` of luminance is `level(y)`, counted from the top.
fn bottom_up(path: &Path, fourcc: &[u8; 4], chroma_bytes: usize, level: impl Fn(usize) -> u8) {
    const WIDTH: usize = 256;
    const HEIGHT: usize = 128;
    const FRAMES: u32 = 15;
    let chunk = |kind: &[u8], data: &[u8]| {
        let mut bytes = kind.to_vec();
        bytes.extend_from_slice(&(data.len() as u32).to_le_bytes());
        bytes.extend_from_slice(data);
        if data.len() % 2 == 1 {
            bytes.push(0);
        }
        bytes
    };
    let list = |kind: &[u8], data: &[u8]| chunk(b"LIST", &[kind, data].concat());
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|w| w.to_le_bytes()).collect() };
    let mut image: Vec<u8> = (0..HEIGHT)
        .rev()
        .flat_map(|y| std::iter::repeat_n(level(y), WIDTH))
        .collect();
    image.resize(image.len() + chroma_bytes, 128);
    let size = image.len() as u32;
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    let main = words(&[
        100_000, 0, 0, 0x10, FRAMES, 0, 1, size, width, height, 0, 0, 0, 0,
    ]);
    let mut stream = [b"vids".as_slice(), fourcc].concat();
    stream.extend(words(&[0, 0, 0, 1, 10, 0, FRAMES, size, 0, 0, 0]));
    let extra = b"BottomUp\0";
    let mut format = words(&[40 + extra.len() as u32, width, height]);
    let bits = 8 + 8 * chroma_bytes as u32 / (width * height);
    format.extend(words(&[1 | bits << 16]));
    format.extend_from_slice(fourcc);
    format.extend(words(&[size, 0, 0, 0, 0]));
    format.extend_from_slice(extra);
    let tracks = [chunk(b"strh", &stream), chunk(b"strf", &format)].concat();
    let header = [chunk(b"avih", &main), list(b"strl", &tracks)].concat();
    let frames = chunk(b"00dc", &image).repeat(FRAMES as usize);
    let index: Vec<u8> = (0..FRAMES)
        .flat_map(|k| [b"00dc".to_vec(), words(&[16, 4 + k * (size + 8), size])].concat())
        .collect();
    let file = [
        b"AVI ".to_vec(),
        list(b"hdrl", &header),
        list(b"movi", &frames),
        chunk(b"idx1", &index),
    ]
    .concat();
    fs::write(path, chunk(b"RIFF", &file)).unwrap();
}

#[test]
fn images_stored_from_the_bottom_up_are_read_the_right_way_up() {
    let temp = tempfile::tempdir().unwrap();
    for (name, fourcc, chroma_bytes) in [
        ("colour.avi", b"I420", 256 * 128 / 2),
        ("grey.avi", b"Y800", 0),
    ] {
        let video = temp.path().join(name);
        // Bright above, dark below.
        bottom_up(&video, fourcc, chroma_bytes, |y| 220 - y as u8);
        assert_eq!(analysed(&video).probe.decoded_frames, Some(15), "{name}");
        for scaling in [Scaling::Native, Scaling::MaxWidth(64)] {
            let mut reader = VideoReader::open(&video).unwrap();
            let frame = reader.next_frame().unwrap().unwrap();
            let image = Converter::new(scaling)
                .convert(&video, &frame.image)
                .unwrap();
            let grey = |y: usize| image.pixel(0, y)[1];
            assert!(
                grey(0) > grey(image.height - 1) + 80,
                "{name} {scaling:?}: {} above, {} below",
                grey(0),
                grey(image.height - 1)
            );
        }
    }
}

/// Frames are chosen among those that there are: time costs neither memory nor work.
#[test]
fn a_gap_of_a_century_between_two_frames() {
    let temp = tempfile::tempdir().unwrap();
    ffmpeg(
        temp.path(),
        "-f lavfi -i testsrc2=s=256x128:d=4:r=10 -vf setpts='PTS+if(gte(N,20),3e9/TB,0)' \
         -fps_mode passthrough -c:v mjpeg gap.mkv",
    );
    let out = temp.path().join("out");
    let settings = CurateSettings {
        profile: "none".to_owned(),
        enforce: false,
        sampling: Sampling::FramesPerSecond(5.0),
        accept: Some(VideoProjection::Erp),
        ..CurateSettings::default()
    };
    let sequences = curate_video(&temp.path().join("gap.mkv"), &out, &settings, &Silent).unwrap();
    let frames: usize = sequences
        .iter()
        .map(|name| {
            let record: Sequence =
                store::read_record(&out.join(name).join("sequence.json")).unwrap();
            record.frames.entries.len()
        })
        .sum();
    assert!((2..=40).contains(&frames), "{frames} frames");
}

/// A file named like the others does not keep them from being read.
#[test]
fn hostile_headers_beside_sound_videos() {
    let temp = tempfile::tempdir().unwrap();
    let hostile = with_colour(temp.path(), [0x55, 0xba], "b.mkv");
    let sound = erp_clip(temp.path(), "c.mp4", &[1], 40, 30);
    let settings = CurateSettings {
        profile: "none".to_owned(),
        enforce: false,
        accept: Some(VideoProjection::Erp),
        ..CurateSettings::default()
    };
    let curated = omnilife_curate::curate_dataset(
        &[hostile, sound],
        &temp.path().join("out"),
        &settings,
        &Silent,
    )
    .unwrap();
    assert!(curated.errors.is_empty(), "{:?}", curated.errors);
}
