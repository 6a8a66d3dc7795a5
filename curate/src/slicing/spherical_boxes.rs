//! Spherical metadata of mp4 files: Google's Spherical Video V2 boxes `st3d` and `sv3d`
//! (<https://github.com/google/spatial-media/blob/master/docs/spherical-video-v2-rfc.md>), and the
//! display rotation of the track header.
//!
//! They are inserted into a finished file. FFmpeg can write the boxes too, but by an API that changed three times
//! between its versions 5 and 8.

use std::{
    fs::OpenOptions,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

use omnilife_schemas::records::{Probe, SphereTurn};

use crate::video::mp4_boxes::{Span, VISUAL_ENTRY_BYTES, boxed, boxes, in_bytes};

/// Path of boxes to the sample descriptions.
const CONTAINERS: [&[u8; 4]; 5] = [b"moov", b"trak", b"mdia", b"minf", b"stbl"];
/// Sample entries of video codecs.
const VIDEO_ENTRIES: [&[u8; 4]; 8] = [
    b"avc1", b"avc3", b"hvc1", b"hev1", b"vp09", b"av01", b"mp4v", b"vp08",
];
/// Metadata source in the `svhd` box.
const METADATA_SOURCE: &str = "omnilife";

/// The rotation that players apply to the frames of a video.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Orientation {
    /// Clockwise quarter turns of the image.
    pub quarter_turns: u32,
    /// Pose of the sphere; `None` for none.
    pub pose: Option<SphereTurn>,
}

impl Orientation {
    /// Reads the orientation in a video's container.
    pub fn of(probe: &Probe) -> Self {
        Self {
            quarter_turns: (probe.rotation_degrees / 90.0).round() as u32,
            pose: probe.spherical.as_ref().and_then(|stated| stated.pose),
        }
    }

    /// Returns yaw, pitch and roll of the pose in 16.16 degrees.
    fn pose_numbers(self) -> [i32; 3] {
        let Some(pose) = self.pose else {
            return [0; 3];
        };
        [pose.yaw_degrees, pose.pitch_degrees, pose.roll_degrees]
            .map(|degrees| (degrees * 65536.0).round() as i32)
    }
}

/// Marks the video tracks of an mp4 file as one equirectangular image of the whole sphere, with this
/// orientation.
///
/// # Errors
/// When the file cannot be read or written, its index (`moov`) is not its last box, or it has no
/// video track.
pub fn mark_equirectangular(path: &Path, orientation: Orientation) -> io::Result<()> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let (offset, length) = find_index(&mut file)?;
    let mut index = vec![0; length];
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(&mut index)?;
    let mut marked = 0;
    let rewritten = rewritten(&index, orientation, &mut marked)?;
    if marked == 0 {
        return Err(broken("it has no video track"));
    }
    file.seek(SeekFrom::Start(offset))?;
    file.write_all(&rewritten)?;
    file.sync_all()
}

/// Returns offset and length of `moov`, which must be the last box: the frames before it keep their places when it
/// grows.
fn find_index(file: &mut std::fs::File) -> io::Result<(u64, usize)> {
    let end = file.seek(SeekFrom::End(0))?;
    let mut offset = 0;
    for (kind, payload) in boxes(file, Span { begin: 0, end })? {
        if &kind != b"moov" {
            offset = payload.end;
            continue;
        }
        if payload.end != end {
            return Err(broken("its index is not at its end"));
        }
        let length = usize::try_from(end - offset).map_err(io::Error::other)?;
        return Ok((offset, length));
    }
    Err(broken("it has no index"))
}

fn broken(reason: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

/// Returns the boxes in `bytes`, with the metadata added in all video tracks.
fn rewritten(bytes: &[u8], orientation: Orientation, marked: &mut usize) -> io::Result<Vec<u8>> {
    let quarter_turns = orientation.quarter_turns;
    let mut out = Vec::with_capacity(bytes.len() + 256);
    for (name, content) in in_bytes(bytes)? {
        match name {
            name if CONTAINERS.contains(&&name) => {
                // Track headers come before the media, so the track's kind is looked up first.
                let inside = if &name != b"trak" || is_video_track(content) {
                    orientation
                } else {
                    Orientation::default()
                };
                let inner = rewritten(content, inside, marked)?;
                out.extend(boxed(name, &inner));
            }
            name if &name == b"tkhd" && !quarter_turns.is_multiple_of(4) => {
                out.extend(boxed(name, &turned_header(content, quarter_turns)?));
            }
            name if &name == b"stsd" => {
                out.extend(boxed(
                    name,
                    &marked_descriptions(content, orientation, marked)?,
                ));
            }
            name => out.extend(boxed(name, content)),
        }
    }
    Ok(out)
}

/// Returns true if the handler of a track is for video.
fn is_video_track(track: &[u8]) -> bool {
    // `hdlr`: version and flags, a reserved word, then the kind.
    track
        .windows(16)
        .any(|window| &window[..4] == b"hdlr" && &window[12..] == b"vide")
}

/// Returns a track header with the matrix of a clockwise rotation (ISO 14496-12, 8.3.2).
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

/// Returns sample descriptions with the spherical boxes at the end of every video entry.
fn marked_descriptions(
    content: &[u8],
    orientation: Orientation,
    marked: &mut usize,
) -> io::Result<Vec<u8>> {
    let (head, entries) = content
        .split_at_checked(8)
        .ok_or_else(|| broken("sample descriptions are too short"))?;
    let mut out = head.to_vec();
    for (name, entry) in in_bytes(entries)? {
        if VIDEO_ENTRIES.contains(&&name) {
            let mut entry = without_spherical_boxes(entry)?;
            entry.extend(spherical_boxes(orientation));
            out.extend(boxed(name, &entry));
            *marked += 1;
        } else {
            out.extend(boxed(name, entry));
        }
    }
    Ok(out)
}

/// Returns a visual sample entry's content without the spherical boxes of a copied source.
fn without_spherical_boxes(entry: &[u8]) -> io::Result<Vec<u8>> {
    let (fixed, children) = entry
        .split_at_checked(VISUAL_ENTRY_BYTES)
        .ok_or_else(|| broken("a video sample entry is too short"))?;
    let mut out = fixed.to_vec();
    for (name, content) in in_bytes(children)? {
        if &name != b"st3d" && &name != b"sv3d" {
            out.extend(boxed(name, content));
        }
    }
    Ok(out)
}

/// Returns `st3d` (monoscopic) and `sv3d` (equirectangular, the whole sphere, with its pose).
fn spherical_boxes(orientation: Orientation) -> Vec<u8> {
    // Version and flags of a full box.
    let full = [0_u8; 4];
    let st3d = boxed(*b"st3d", &[&full[..], &[0]].concat());
    let svhd = boxed(
        *b"svhd",
        &[&full[..], METADATA_SOURCE.as_bytes(), &[0]].concat(),
    );
    let pose = orientation.pose_numbers().map(i32::to_be_bytes);
    let prhd = boxed(*b"prhd", &[&full[..], pose.as_flattened()].concat());
    // The bounds top, bottom, left and right.
    let equi = boxed(*b"equi", &[0; 4 + 4 * 4]);
    let proj = boxed(*b"proj", &[prhd, equi].concat());
    let sv3d = boxed(*b"sv3d", &[svhd, proj].concat());
    [st3d, sv3d].concat()
}
