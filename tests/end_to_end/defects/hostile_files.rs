//! Files that are made to break readers. The only other program that they need is FFmpeg's command line.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::Value;
use tempfile::TempDir;

use crate::{
    support::{SEQUENCE, files, sample, scratch, small_run},
    writing_commands::copy,
};

/// Folder of hostile files.
pub(super) struct Hostile {
    folder: TempDir,
}

impl Hostile {
    /// Makes them; returns `None` without an `ffmpeg` command.
    pub(super) fn make() -> Option<Self> {
        let hostile = Self { folder: scratch() };
        let at = |name: &str| hostile.path(name);
        let clips = [
            (
                "plain.mkv",
                "testsrc2=s=256x128:d=2:r=10",
                "-c:v mpeg4 -color_trc bt709 -color_primaries bt709 -colorspace bt709",
            ),
            ("tiny.mp4", "smptebars=s=32x16:d=2:r=10", "-c:v mpeg4"),
            (
                "gap.mkv",
                "testsrc2=s=256x128:d=4:r=10",
                "-vf setpts='PTS+if(gte(N,20),3e9/TB,0)' -fps_mode passthrough -c:v mjpeg",
            ),
        ];
        for (name, source, options) in clips {
            let made = Command::new("ffmpeg")
                .args(["-nostdin", "-v", "error", "-f", "lavfi", "-i", source])
                .args(options.split(' '))
                .arg(at(name))
                .status();
            if !made.is_ok_and(|status| status.success()) {
                return None;
            }
        }
        let plain = fs::read(at("plain.mkv")).unwrap();
        for (name, element) in [("colour-trc.mkv", 0xba), ("colour-matrix.mkv", 0xb1)] {
            fs::write(at(name), with_colour(&plain, element)).unwrap();
        }
        fs::write(at("bottom-up.avi"), bottom_up(*b"I420", 12)).unwrap();
        fs::write(at("bottom-up-grey.avi"), bottom_up(*b"Y800", 8)).unwrap();
        let playlist = format!(
            "#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:2.0,\nfile://{}\n#EXT-X-ENDLIST\n",
            sample("street.mp4").display()
        );
        fs::write(at("playlist.mp4"), playlist).unwrap();
        Some(hostile)
    }

    /// Returns the path of a file or folder in it.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns [`Hostile::path`] as a word of a command.
    pub(super) fn word(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Writes a file, and its folder where that is missing.
    pub(super) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, content).unwrap();
        self.word(name)
    }

    /// Copies a folder of the sample's run.
    pub(super) fn copy_of(&self, folder: &str, name: &str) -> String {
        copy(&small_run().out.join(folder), &self.path(name));
        self.word(name)
    }

    pub(super) fn sequence(
        &self,
        name: &str,
        record: &str,
        change: impl FnOnce(&mut Value),
    ) -> String {
        let folder = self.copy_of(SEQUENCE, name);
        self.change(&format!("{name}/{record}"), change);
        folder
    }

    /// Changes a JSON file.
    pub(super) fn change(&self, name: &str, change: impl FnOnce(&mut Value)) {
        let text = fs::read(self.path(name)).unwrap();
        let mut value: Value = serde_json::from_slice(&text).unwrap();
        change(&mut value);
        self.write(name, value.to_string());
    }

    /// Returns the content of a file; empty where it is missing.
    pub(super) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_default()
    }

    /// Returns the files of a folder whose content, as text, `is_wrong` flags.
    pub(super) fn files_where(
        &self,
        name: &str,
        is_wrong: impl Fn(&str, &str) -> bool,
    ) -> Vec<String> {
        let folder = self.path(name);
        let mut found = files(&folder);
        found.retain(|file| {
            let text = String::from_utf8_lossy(&fs::read(folder.join(file)).unwrap()).into_owned();
            is_wrong(file, &text)
        });
        found
    }
}

/// Returns the Matroska colour element with a value outside of FFmpeg's enumerations.
fn with_colour(plain: &[u8], element: u8) -> Vec<u8> {
    // MatrixCoefficients, TransferCharacteristics and Primaries of one byte each, in this order.
    let at = plain
        .windows(4)
        .position(|bytes| bytes == [0x55, 0xba, 0x81, 0x01])
        .unwrap();
    assert_eq!([plain[at + 5], plain[at + 9]], [0xb1, 0xbb]);
    let mut bytes = plain.to_vec();
    let value = [
        0x55, element, 0x87, 0, 0, 0, 0x7f, 0xff, 0xff, 0xff, 0xec, 0x80,
    ];
    bytes[at..at + 12].copy_from_slice(&value);
    bytes
}

/// Returns an AVI file of raw video whose extra data state that its rows run upwards.
fn bottom_up(four_characters: [u8; 4], bits: u32) -> Vec<u8> {
    const FRAMES: u32 = 15;
    let (width, height) = (256_u32, 128_u32);
    let size = width * height * bits / 8;
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut bytes = kind.to_vec();
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(data);
        bytes.extend(std::iter::repeat_n(0, data.len() % 2));
        bytes
    };
    let list = |kind: &[u8; 4], data: &[u8]| chunk(b"LIST", &[kind.as_slice(), data].concat());
    let words = |words: &[u32]| {
        words
            .iter()
            .flat_map(|word| word.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let header = words(&[
        100_000, 0, 0, 0x10, FRAMES, 0, 1, size, width, height, 0, 0, 0, 0,
    ]);
    let mut stream = b"vids".to_vec();
    stream.extend(four_characters);
    stream.extend(words(&[
        0,
        0,
        0,
        1,
        10,
        0,
        FRAMES,
        size,
        0,
        0,
        0,
        width | height << 16,
    ]));
    let extra = b"BottomUp\0";
    let mut format = words(&[40 + extra.len() as u32, width, height, 1 | bits << 16]);
    format.extend(four_characters);
    format.extend(words(&[size, 0, 0, 0, 0]));
    format.extend(extra);
    let streams = [chunk(b"strh", &stream), chunk(b"strf", &format)].concat();
    let head = [chunk(b"avih", &header), list(b"strl", &streams)].concat();
    let frame = |number: u32| -> Vec<u8> {
        let pixels: Vec<u8> = (0..size)
            .map(|at| ((number * 7 + at) % 251) as u8)
            .collect();
        chunk(b"00dc", &pixels)
    };
    let frames: Vec<u8> = (0..FRAMES).flat_map(frame).collect();
    let body = [
        b"AVI ".as_slice(),
        &list(b"hdrl", &head),
        &list(b"movi", &frames),
    ]
    .concat();
    chunk(b"RIFF", &body)
}

/// Returns a PNG of some hundred kilobytes with so many grey pixels that decoding takes gigabytes.
pub(super) fn bomb(side: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels = vec![0x80; side as usize * side as usize];
    PngEncoder::new(&mut bytes)
        .write_image(&pixels, side, side, ExtendedColorType::L8)
        .unwrap();
    bytes
}

/// Counts the processes that were started with this word.
pub(super) fn processes_with(word: &str) -> usize {
    let has_word = |process: &Path| {
        let line = fs::read(process.join("cmdline")).unwrap_or_default();
        line.split(|byte| *byte == 0)
            .any(|held| held == word.as_bytes())
    };
    let processes = fs::read_dir("/proc")
        .unwrap()
        .map(|entry| entry.unwrap().path());
    processes.filter(|process| has_word(process)).count()
}
