//! Spherical metadata of mp4 files: Google's Spherical Video V2 boxes `st3d` and `sv3d`
//! (<https://github.com/google/spatial-media/blob/master/docs/spherical-video-v2-rfc.md>), and the
//! display rotation of the track header.
//!
//! They are put into a finished file. FFmpeg can write the boxes too, but through a programming
//! interface that changed three times between its versions 5 and 8.

use std::{
    fs::OpenOptions,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

/// Boxes on the way to the sample descriptions.
const CONTAINERS: [&[u8; 4]; 5] = [b"moov", b"trak", b"mdia", b"minf", b"stbl"];
/// Sample entries of video codecs.
const VIDEO_ENTRIES: [&[u8; 4]; 8] = [
    b"avc1", b"avc3", b"hvc1", b"hev1", b"vp09", b"av01", b"mp4v", b"vp08",
];
/// Bytes of a visual sample entry before its child boxes, header included (ISO 14496-12, 12.1.3).
const VISUAL_ENTRY_BYTES: usize = 86;
/// Who says so, in the `svhd` box.
const METADATA_SOURCE: &str = "omnilife";

/// Marks the video tracks of an mp4 file as one equirectangular picture of the whole sphere, and
/// sets their display rotation to `quarter_turns` clockwise quarter turns.
///
/// # Errors
/// When the file cannot be read or written, its index (`moov`) is not its last box, or it has no
/// video track.
pub fn mark_equirectangular(path: &Path, quarter_turns: u32) -> io::Result<()> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let (offset, length) = find_index(&mut file)?;
    let mut index = vec![0; length];
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(&mut index)?;
    let mut marked = 0;
    let rewritten = rewritten(&index, quarter_turns, &mut marked)?;
    if marked == 0 {
        return Err(broken("it has no video track"));
    }
    file.seek(SeekFrom::Start(offset))?;
    file.write_all(&rewritten)?;
    file.sync_all()
}

/// Offset and length of `moov`, which has to be the last box: the frames before it keep their
/// places when it grows.
fn find_index(file: &mut std::fs::File) -> io::Result<(u64, usize)> {
    let end = file.seek(SeekFrom::End(0))?;
    let mut offset = 0;
    while offset + 8 <= end {
        let mut header = [0; 16];
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(&mut header[..8])?;
        let size = match u32::from_be_bytes([header[0], header[1], header[2], header[3]]) {
            0 => end - offset,
            1 => {
                file.read_exact(&mut header[8..])?;
                u64::from_be_bytes(header[8..].try_into().map_err(|_| broken("no size"))?)
            }
            size => u64::from(size),
        };
        if size < 8 || offset + size > end {
            return Err(broken("a box is longer than the file"));
        }
        if &header[4..8] == b"moov" {
            if offset + size != end {
                return Err(broken("its index is not at its end"));
            }
            let length = usize::try_from(size).map_err(io::Error::other)?;
            return Ok((offset, length));
        }
        offset += size;
    }
    Err(broken("it has no index"))
}

fn broken(reason: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

/// The boxes in `bytes`, with the metadata added in all video tracks.
fn rewritten(bytes: &[u8], quarter_turns: u32, marked: &mut usize) -> io::Result<Vec<u8>> {
    let mut out = Vec::with_capacity(bytes.len() + 256);
    let mut rest = bytes;
    while !rest.is_empty() {
        let (name, content, after) = split_box(rest)?;
        rest = after;
        match name {
            name if CONTAINERS.contains(&&name) => {
                // Track headers come before the media, so the track's kind is looked up first.
                let turns = if &name != b"trak" || is_video_track(content) {
                    quarter_turns
                } else {
                    0
                };
                let inner = rewritten(content, turns, marked)?;
                out.extend(boxed(name, &inner));
            }
            name if &name == b"tkhd" && !quarter_turns.is_multiple_of(4) => {
                out.extend(boxed(name, &turned_header(content, quarter_turns)?));
            }
            name if &name == b"stsd" => {
                out.extend(boxed(name, &marked_descriptions(content, marked)?));
            }
            name => out.extend(boxed(name, content)),
        }
    }
    Ok(out)
}

/// Name and content of the first box, and the bytes after it.
fn split_box(bytes: &[u8]) -> io::Result<([u8; 4], &[u8], &[u8])> {
    let header = bytes
        .first_chunk::<8>()
        .ok_or_else(|| broken("half a box"))?;
    let [a, b, c, d, name @ ..] = *header;
    let size = u32::from_be_bytes([a, b, c, d]) as usize;
    if size < 8 || size > bytes.len() {
        return Err(broken("a box is longer than what holds it"));
    }
    Ok((name, &bytes[8..size], &bytes[size..]))
}

fn boxed(name: [u8; 4], content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(content.len() + 8);
    bytes.extend((content.len() as u32 + 8).to_be_bytes());
    bytes.extend(name);
    bytes.extend(content);
    bytes
}

/// Whether the handler of a track is for video.
fn is_video_track(track: &[u8]) -> bool {
    // `hdlr`: version and flags, a reserved word, then the kind.
    track
        .windows(16)
        .any(|window| &window[..4] == b"hdlr" && &window[12..] == b"vide")
}

/// A track header with the matrix of a clockwise rotation (ISO 14496-12, 8.3.2).
fn turned_header(content: &[u8], quarter_turns: u32) -> io::Result<Vec<u8>> {
    let is_long = content.first() == Some(&1);
    let at = if is_long { 52 } else { 40 };
    let mut header = content.to_vec();
    let numbers = header
        .get_mut(at..at + 44)
        .ok_or_else(|| broken("a track header is too short"))?;
    // Width and height in 16.16 follow the matrix.
    let size = |bytes: &[u8]| i32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let (width, height) = (size(&numbers[36..]), size(&numbers[40..]));
    let one = 1 << 16;
    let [a, b, c, d, x, y] = match quarter_turns % 4 {
        1 => [0, one, -one, 0, height, 0],
        2 => [-one, 0, 0, -one, width, height],
        _ => [0, -one, one, 0, 0, width],
    };
    for (slot, value) in [a, b, 0, c, d, 0, x, y, 1 << 30].into_iter().enumerate() {
        numbers[4 * slot..4 * slot + 4].copy_from_slice(&value.to_be_bytes());
    }
    Ok(header)
}

/// Sample descriptions with the spherical boxes at the end of every video entry.
fn marked_descriptions(content: &[u8], marked: &mut usize) -> io::Result<Vec<u8>> {
    let (head, mut entries) = content
        .split_at_checked(8)
        .ok_or_else(|| broken("sample descriptions are too short"))?;
    let mut out = head.to_vec();
    while !entries.is_empty() {
        let (name, entry, rest) = split_box(entries)?;
        entries = rest;
        if VIDEO_ENTRIES.contains(&&name) {
            let mut entry = without_spherical_boxes(entry)?;
            entry.extend(spherical_boxes());
            out.extend(boxed(name, &entry));
            *marked += 1;
        } else {
            out.extend(boxed(name, entry));
        }
    }
    Ok(out)
}

/// A visual sample entry's content less any spherical boxes that a copy brought along.
fn without_spherical_boxes(entry: &[u8]) -> io::Result<Vec<u8>> {
    let (fixed, mut children) = entry
        .split_at_checked(VISUAL_ENTRY_BYTES - 8)
        .ok_or_else(|| broken("a video sample entry is too short"))?;
    let mut out = fixed.to_vec();
    while children.len() >= 8 {
        let (name, content, rest) = split_box(children)?;
        children = rest;
        if &name != b"st3d" && &name != b"sv3d" {
            out.extend(boxed(name, content));
        }
    }
    Ok(out)
}

/// `st3d` (monoscopic) and `sv3d` (equirectangular, the whole sphere, not turned).
fn spherical_boxes() -> Vec<u8> {
    // Version and flags of a full box.
    let full = [0_u8; 4];
    let st3d = boxed(*b"st3d", &[&full[..], &[0]].concat());
    let svhd = boxed(
        *b"svhd",
        &[&full[..], METADATA_SOURCE.as_bytes(), &[0]].concat(),
    );
    // Yaw, pitch and roll; then the bounds top, bottom, left and right.
    let prhd = boxed(*b"prhd", &[0; 4 + 3 * 4]);
    let equi = boxed(*b"equi", &[0; 4 + 4 * 4]);
    let proj = boxed(*b"proj", &[prhd, equi].concat());
    let sv3d = boxed(*b"sv3d", &[svhd, proj].concat());
    [st3d, sv3d].concat()
}
