//! Event files of TensorBoard: scalars and images by iteration.
//!
//! A file is a sequence of TFRecord frames: the length of the data in 8 bytes, the masked CRC-32C of these bytes, the
//! data, and their masked CRC-32C; all little-endian. The data are `Event` messages of Protocol Buffers, as
//! `event.proto` and `summary.proto` of TensorBoard define them; only the fields below are written.

use std::{
    path::Path,
    process,
    sync::atomic::{AtomicU64, Ordering},
    time::{SystemTime, UNIX_EPOCH},
};

use omnilife_schemas::{
    RgbImage,
    store::{GrowingFile, StoreError},
};

/// Fields of an `Event`: f64 seconds since 1970, iteration, and one of three contents.
const WALL_TIME: u64 = 1;
const STEP: u64 = 2;
const FILE_VERSION: u64 = 3;
const SUMMARY: u64 = 5;
const SESSION_LOG: u64 = 7;
/// Field of a `Summary`, repeated, with fields of its own.
const VALUE: u64 = 1;
const TAG: u64 = 1;
const SIMPLE_VALUE: u64 = 2;
const IMAGE: u64 = 4;
/// Fields of an `Image`.
const HEIGHT: u64 = 1;
const WIDTH: u64 = 2;
const COLOUR_SPACE: u64 = 3;
const ENCODED: u64 = 4;
/// Colour space of red, green and blue.
const RGB: u64 = 3;
/// Field of a `SessionLog`, and its value at a start.
const STATUS: u64 = 1;
const START: u64 = 1;

#[derive(Debug)]
pub(super) struct EventFile(GrowingFile);

impl EventFile {
    /// Creates a file with a name of its own in `folder`. TensorBoard drops the iterations from `first` on of older
    /// files there: a resumed run repeats them.
    pub(super) fn create(folder: &Path, first: u64) -> Result<Self, StoreError> {
        static FILES: AtomicU64 = AtomicU64::new(0);
        let name = format!(
            "events.out.tfevents.{}.{}.{}.omnilife",
            now().floor(),
            process::id(),
            FILES.fetch_add(1, Ordering::Relaxed)
        );
        let mut file = Self(GrowingFile::create(&folder.join(name))?);
        file.append(event(0).bytes(FILE_VERSION, b"brain.Event:2"))?;
        let log = Message::default().number(STATUS, START);
        file.append(event(first).bytes(SESSION_LOG, &log.0))?;
        Ok(file)
    }

    pub(super) fn add(
        &mut self,
        iteration: u64,
        scalars: impl Iterator<Item = (String, f64)>,
        images: &[(&str, PngImage)],
    ) -> Result<(), StoreError> {
        let mut summary = Message::default();
        for (tag, value) in scalars {
            let value = Message::tagged(&tag).float(SIMPLE_VALUE, value as f32);
            summary = summary.bytes(VALUE, &value.0);
        }
        for (tag, image) in images {
            let image = Message::default()
                .number(HEIGHT, image.height)
                .number(WIDTH, image.width)
                .number(COLOUR_SPACE, RGB)
                .bytes(ENCODED, &image.png);
            let value = Message::tagged(tag).bytes(IMAGE, &image.0);
            summary = summary.bytes(VALUE, &value.0);
        }
        self.append(event(iteration).bytes(SUMMARY, &summary.0))
    }

    fn append(&mut self, event: Message) -> Result<(), StoreError> {
        self.0.append(&frame(&event.0))
    }
}

/// Image as TensorBoard shows it.
#[derive(Debug)]
pub(super) struct PngImage {
    width: u64,
    height: u64,
    png: Vec<u8>,
}

impl PngImage {
    pub(super) fn new(image: &RgbImage) -> std::io::Result<Self> {
        Ok(Self {
            width: image.width as u64,
            height: image.height as u64,
            png: image.png()?,
        })
    }
}

/// Message of Protocol Buffers under construction.
#[derive(Debug, Default)]
struct Message(Vec<u8>);

impl Message {
    /// Makes a value of a `Summary`.
    fn tagged(tag: &str) -> Self {
        Self::default().bytes(TAG, tag.as_bytes())
    }

    fn number(self, field: u64, value: u64) -> Self {
        self.varint(field << 3).varint(value)
    }

    fn double(self, field: u64, value: f64) -> Self {
        self.varint((field << 3) | 1).raw(&value.to_le_bytes())
    }

    fn bytes(self, field: u64, value: &[u8]) -> Self {
        let begun = self.varint((field << 3) | 2).varint(value.len() as u64);
        begun.raw(value)
    }

    fn float(self, field: u64, value: f32) -> Self {
        self.varint((field << 3) | 5).raw(&value.to_le_bytes())
    }

    /// Appends seven bits per byte, the lowest first; the highest bit of a byte says that more follow.
    fn varint(mut self, mut value: u64) -> Self {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
        self
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }
}

fn event(iteration: u64) -> Message {
    Message::default()
        .double(WALL_TIME, now())
        .number(STEP, iteration)
}

/// Returns the seconds since 1970; 0 where the clock is before.
fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |time| time.as_secs_f64())
}

fn frame(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let checks = [masked_crc(&length), masked_crc(data)].map(u32::to_le_bytes);
    [&length[..], &checks[0], data, &checks[1]].concat()
}

/// Remainders of the bytes by the polynomial of Castagnoli, bits reversed.
static REMAINDERS: [u32; 256] = {
    let mut remainders = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut remainder, mut bit) = (byte as u32, 0);
        while bit < 8 {
            remainder = (remainder >> 1) ^ (0x82f6_3b78 * (remainder & 1));
            bit += 1;
        }
        remainders[byte] = remainder;
        byte += 1;
    }
    remainders
};

fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, byte| {
        (crc >> 8) ^ REMAINDERS[usize::from(crc as u8 ^ byte)]
    })
}

/// Returns the check sum as TFRecord stores it, turned and shifted: data may hold check sums themselves.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_sums_are_the_published_ones() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        // RFC 3720, B.4.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
    }

    /// Returns the data of the frames of a file; checks the sums.
    fn frames(mut bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut frames = Vec::new();
        while !bytes.is_empty() {
            let length = u64::from_le_bytes(bytes[..8].try_into().expect("8 bytes"));
            let end = 12 + length as usize;
            assert_eq!(bytes[..end + 4], frame(&bytes[12..end]));
            frames.push(bytes[12..end].to_vec());
            bytes = &bytes[end + 4..];
        }
        frames
    }

    #[test]
    fn files_hold_what_was_added() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut file = EventFile::create(folder.path(), 301).expect("created");
        let image = RgbImage::black(3, 2);
        let png = PngImage::new(&image).expect("encoded");
        let encoded = png.png.clone();
        let scalars = [("trace/train_loss".to_owned(), 0.5)];
        file.add(400, scalars.into_iter(), &[("views/novel", png)])
            .expect("written");
        // A second one at the same time has another name.
        EventFile::create(folder.path(), 0).expect("created");
        let mut files: Vec<_> = (std::fs::read_dir(folder.path()).expect("read"))
            .map(|file| {
                let file = file.expect("a file");
                let name = file.file_name().into_string().expect("text");
                assert!(name.starts_with("events.out.tfevents."), "{name}");
                frames(&std::fs::read(file.path()).expect("read"))
            })
            .collect();
        files.sort_by_key(Vec::len);
        let [second, found] = &files[..] else {
            panic!("{} files", files.len())
        };
        assert_eq!((second.len(), found.len()), (2, 3));
        // Tag and f64, then the iteration and the content.
        let content = |frame: usize| {
            assert_eq!(found[frame][0], 0x09);
            found[frame][9..].to_vec()
        };
        assert_eq!(content(0), b"\x10\x00\x1a\x0dbrain.Event:2");
        assert_eq!(content(1), b"\x10\xad\x02\x3a\x02\x08\x01");
        let half = 0.5_f32.to_le_bytes();
        let scalar = [&b"\x0a\x17\x0a\x10trace/train_loss\x15"[..], &half].concat();
        let at_400 = content(2);
        let place = at_400.windows(scalar.len()).position(|part| part == scalar);
        assert!(at_400.starts_with(b"\x10\x90\x03\x2a") && place.is_some());
        assert!(at_400.ends_with(&encoded));
    }
}
