//! Google's spherical metadata in MP4 and MOV files, as stored.
//!
//! Version 1 is an XML document in a `uuid` box of the track, version 2 the boxes `st3d` and `sv3d` in the sample
//! description (<https://github.com/google/spatial-media/tree/master/docs>). A file may hold both, and they may differ;
//! FFmpeg returns one without saying which.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    fs::File,
    io::{self, BufReader, Read, Seek, SeekFrom},
    path::Path,
};

use super::mp4_boxes::{Span, VISUAL_ENTRY_BYTES, boxes, bytes_at, children};

/// Identifies the version 1 box.
const V1_UUID: [u8; 16] = [
    0xff, 0xcc, 0x82, 0x63, 0xf8, 0x55, 0x4a, 0x93, 0x88, 0x14, 0x58, 0x7a, 0x02, 0x52, 0x1f, 0xdd,
];
/// An XML document longer than this is not read.
const MOST_XML_BYTES: u64 = 1 << 20;

/// Faces without padding in the layout that is defined: right, left and up above down, front and back.
pub const CUBEMAP: &str = "cubemap";
/// Faces with padding, or in another layout.
pub const OTHER_CUBEMAP: &str = "cubemap of another layout";

/// Content of one version of the metadata, in FFmpeg's names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Statement {
    /// Projection, if stated.
    pub(super) projection: Option<String>,
    /// Stereo layout, if stated.
    pub(super) stereo: Option<String>,
    /// The image's part of the sphere.
    pub(super) extent: Extent,
    /// Yaw, pitch and roll in 16.16 degrees, if stated: of the initial view in version 1, of the pose in version 2.
    pub(super) turn: Option<[i32; 3]>,
}

/// Part of the sphere in an image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Extent {
    /// All of it.
    #[default]
    Whole,
    /// Half a turn across, all of it down.
    FrontHalf,
    /// Another part.
    Part,
}

impl Extent {
    /// Returns the extent of an image that omits these shares of the sphere on its left, at its top, on its right and
    /// at its bottom, in 0.32.
    pub(super) fn of_bounds(bounds: [u32; 4]) -> Self {
        let [left, top, right, bottom] = bounds.map(|share| f64::from(share) / 2_f64.powi(32));
        Self::of_shares([left, right], top + bottom > 0.0)
    }

    /// Returns the extent of an image that omits these shares of the turn on its left and right.
    fn of_shares([left, right]: [f64; 2], is_less_high: bool) -> Self {
        // A quarter on each side; widths are whole pixels.
        let is_quarter = |share: f64| (share - 0.25).abs() < 0.01;
        if !is_less_high && is_quarter(left) && is_quarter(right) {
            Self::FrontHalf
        } else if is_less_high || left + right > 0.0 {
            Self::Part
        } else {
            Self::Whole
        }
    }
}

/// Both versions, if the file holds them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct SphericalBoxes {
    pub(super) v1: Option<Statement>,
    pub(super) v2: Option<Statement>,
}

/// Reads the boxes of the track with this id, or of any track if no id fits. For a malformed file it returns the
/// content before the fault.
pub(super) fn read(path: &Path, track_id: u32) -> io::Result<SphericalBoxes> {
    read_from(BufReader::new(File::open(path)?), track_id)
}

fn read_from(mut file: impl Read + Seek, track_id: u32) -> io::Result<SphericalBoxes> {
    let end = file.seek(SeekFrom::End(0))?;
    let whole = Span { begin: 0, end };
    let mut found = SphericalBoxes::default();
    for moov in children(&mut file, whole, b"moov")? {
        for track in children(&mut file, moov, b"trak")? {
            if self::track_id(&mut file, track)?.is_none_or(|id| id == track_id) {
                found.v1 = v1(&mut file, track)?.or(found.v1);
                found.v2 = v2(&mut file, track)?.or(found.v2);
            }
        }
    }
    Ok(found)
}

/// Returns how many of the two versions the boxes of an MP4 file, given by its bytes, state for a track.
///
/// # Errors
/// When a box ends before its required content.
pub fn count_statements(bytes: &[u8], track_id: u32) -> io::Result<usize> {
    let SphericalBoxes { v1, v2 } = read_from(io::Cursor::new(bytes), track_id)?;
    Ok([v1.is_some(), v2.is_some()]
        .into_iter()
        .filter(|is_stated| *is_stated)
        .count())
}

fn track_id(file: &mut (impl Read + Seek), track: Span) -> io::Result<Option<u32>> {
    let Some(&header) = children(file, track, b"tkhd")?.first() else {
        return Ok(None);
    };
    // Version 1 has times of eight bytes.
    let offset = match bytes_at::<1>(file, header, 0)? {
        Some([1]) => 20,
        _ => 12,
    };
    Ok(bytes_at(file, header, offset)?.map(u32::from_be_bytes))
}

fn v1(file: &mut (impl Read + Seek), track: Span) -> io::Result<Option<Statement>> {
    for span in children(file, track, b"uuid")? {
        if bytes_at(file, span, 0)? != Some(V1_UUID) {
            continue;
        }
        file.seek(SeekFrom::Start(span.begin.saturating_add(16)))?;
        let mut xml = Vec::new();
        file.take(
            span.end
                .saturating_sub(span.begin)
                .saturating_sub(16)
                .min(MOST_XML_BYTES),
        )
        .read_to_end(&mut xml)?;
        return Ok(v1_statement(&String::from_utf8_lossy(&xml)));
    }
    Ok(None)
}

fn v1_statement(xml: &str) -> Option<Statement> {
    let entry = |name: &str| {
        let open = format!("<GSpherical:{name}>");
        let (_, after) = xml.split_once(&open)?;
        let (value, _) = after.split_once('<')?;
        Some(value.trim())
    };
    if entry("Spherical").is_some_and(|value| value != "true") {
        return None;
    }
    let number = |name: &str| entry(name)?.parse::<u32>().ok();
    let share = |part: &str, whole: &str| {
        let (part, whole) = (number(part)?, number(whole)?);
        (part < whole).then(|| f64::from(part) / f64::from(whole))
    };
    let across = share("CroppedAreaImageWidthPixels", "FullPanoWidthPixels");
    let across = across.unwrap_or(1.0);
    let left = share("CroppedAreaLeftPixels", "FullPanoWidthPixels").unwrap_or(0.0);
    let is_less_high = share("CroppedAreaImageHeightPixels", "FullPanoHeightPixels").is_some();
    let degrees = |axis: &str| {
        let value: f64 = entry(&format!("InitialView{axis}Degrees"))?.parse().ok()?;
        // The cast saturates, so that values out of range stay so.
        value.is_finite().then(|| (value * 65536.0).round() as i32)
    };
    let view = ["Heading", "Pitch", "Roll"].map(degrees);
    let is_stated = view.iter().any(Option::is_some);
    Some(Statement {
        turn: is_stated.then(|| view.map(Option::unwrap_or_default)),
        projection: entry("ProjectionType").map(str::to_owned),
        stereo: entry("StereoMode").map(|mode| {
            match mode {
                "mono" => "2D",
                "top-bottom" => "top and bottom",
                "left-right" => "side by side",
                other => other,
            }
            .to_owned()
        }),
        extent: Extent::of_shares([left, 1.0 - across - left], is_less_high),
    })
}

fn v2(file: &mut (impl Read + Seek), track: Span) -> io::Result<Option<Statement>> {
    let mut spans = vec![track];
    for kind in [b"mdia", b"minf", b"stbl", b"stsd"] {
        let mut inner = Vec::new();
        for span in spans {
            inner.extend(children(file, span, kind)?);
        }
        spans = inner;
    }
    let mut statement = None;
    for description in spans {
        // Version, flags and the number of entries come first.
        let entries = Span {
            begin: description.begin.saturating_add(8),
            ..description
        };
        for (_, entry) in boxes(file, entries)? {
            let inside = Span {
                begin: entry.begin.saturating_add(VISUAL_ENTRY_BYTES as u64),
                ..entry
            };
            for (kind, span) in boxes(file, inside)? {
                let found = match &kind {
                    b"st3d" | b"sv3d" => statement.get_or_insert_with(Statement::default),
                    _ => continue,
                };
                if kind == *b"st3d" {
                    found.stereo = stereo_mode(bytes_at(file, span, 4)?);
                } else {
                    (found.projection, found.extent) = projection(file, span)?;
                    found.turn = pose(file, span)?;
                }
            }
        }
    }
    Ok(statement)
}

fn stereo_mode(mode: Option<[u8; 1]>) -> Option<String> {
    let [mode] = mode?;
    let name = match mode {
        0 => "2D",
        1 => "top and bottom",
        2 => "side by side",
        _ => "other stereo layout",
    };
    Some(name.to_owned())
}

/// Returns yaw, pitch and roll of the projection header of an `sv3d` box, in 16.16 degrees.
fn pose(file: &mut (impl Read + Seek), sv3d: Span) -> io::Result<Option<[i32; 3]>> {
    for projection in children(file, sv3d, b"proj")? {
        for header in children(file, projection, b"prhd")? {
            let mut at = |offset| -> io::Result<Option<i32>> {
                Ok(bytes_at(file, header, offset)?.map(i32::from_be_bytes))
            };
            // Version and flags come first.
            if let (Some(yaw), Some(pitch), Some(roll)) = (at(4)?, at(8)?, at(12)?) {
                return Ok(Some([yaw, pitch, roll]));
            }
        }
    }
    Ok(None)
}

/// Returns the projection of an `sv3d` box, and the part of the sphere inside its bounds.
fn projection(file: &mut (impl Read + Seek), sv3d: Span) -> io::Result<(Option<String>, Extent)> {
    for projection in children(file, sv3d, b"proj")? {
        for (kind, span) in boxes(file, projection)? {
            match &kind {
                b"equi" => {
                    // Version and flags, then the omissions at the top, the bottom, on the left and on the right, as
                    // shares of the sphere in 0.32.
                    let bounds: [u8; 16] = bytes_at(file, span, 4)?.unwrap_or_default();
                    let shares = bounds.as_chunks::<4>().0.iter();
                    let shares: Vec<u32> = shares.map(|bytes| u32::from_be_bytes(*bytes)).collect();
                    let extent = match shares[..] {
                        [top, bottom, left, right] => Extent::of_bounds([left, top, right, bottom]),
                        _ => Extent::Whole,
                    };
                    return Ok((Some("equirectangular".to_owned()), extent));
                }
                b"cbmp" => {
                    // Version and flags, then the layout, of which only 0 is defined, and the padding in pixels.
                    let is_plain = bytes_at::<8>(file, span, 4)? == Some([0; 8]);
                    let name = if is_plain { CUBEMAP } else { OTHER_CUBEMAP };
                    return Ok((Some(name.to_owned()), Extent::Whole));
                }
                b"mshp" => return Ok((Some("mesh".to_owned()), Extent::Whole)),
                _ => {}
            }
        }
    }
    Ok((None, Extent::Whole))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;
    use crate::mp4_boxes::boxed;

    fn track(id: u32, extra: &[u8], entry_boxes: &[u8]) -> Vec<u8> {
        let mut header = vec![0; 84];
        header[12..16].copy_from_slice(&id.to_be_bytes());
        let mut entry = vec![0; VISUAL_ENTRY_BYTES];
        entry.extend_from_slice(entry_boxes);
        let mut description = vec![0, 0, 0, 0, 0, 0, 0, 1];
        description.extend(boxed(*b"avc1", &entry));
        let table = boxed(*b"stbl", &boxed(*b"stsd", &description));
        let media = boxed(*b"mdia", &boxed(*b"minf", &table));
        boxed(
            *b"trak",
            &[boxed(*b"tkhd", &header), media, extra.to_vec()].concat(),
        )
    }

    fn written(tracks: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("clip.mp4");
        let file = [
            boxed(*b"ftyp", b"isom"),
            boxed(*b"moov", tracks),
            boxed(*b"mdat", &[1, 2, 3]),
        ]
        .concat();
        std::fs::write(&path, file).unwrap();
        (temp, path)
    }

    #[test]
    fn both_versions_of_the_track_asked_for() {
        let xml = "<rdf:SphericalVideo><GSpherical:Spherical>true</GSpherical:Spherical>\
                   <GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>\
                   <GSpherical:StereoMode>top-bottom</GSpherical:StereoMode>\
                   <GSpherical:CroppedAreaImageWidthPixels>900</GSpherical:CroppedAreaImageWidthPixels>\
                   <GSpherical:FullPanoWidthPixels>1000</GSpherical:FullPanoWidthPixels>";
        let uuid = boxed(*b"uuid", &[&V1_UUID, xml.as_bytes()].concat());
        let equi = boxed(*b"equi", &[0; 20]);
        let sv3d = boxed(
            *b"sv3d",
            &boxed(*b"proj", &[boxed(*b"prhd", &[0; 16]), equi].concat()),
        );
        let st3d = boxed(*b"st3d", &[0, 0, 0, 0, 2]);
        let tracks = [
            track(
                7,
                &[],
                &boxed(*b"sv3d", &boxed(*b"proj", &boxed(*b"cbmp", &[0; 12]))),
            ),
            track(2, &uuid, &[st3d, sv3d].concat()),
        ]
        .concat();
        let (_temp, path) = written(&tracks);
        let found = read(&path, 2).unwrap();
        assert_eq!(
            found.v1,
            Some(Statement {
                projection: Some("equirectangular".to_owned()),
                stereo: Some("top and bottom".to_owned()),
                extent: Extent::Part,
                turn: None,
            })
        );
        assert_eq!(
            found.v2,
            Some(Statement {
                projection: Some("equirectangular".to_owned()),
                stereo: Some("side by side".to_owned()),
                extent: Extent::Whole,
                turn: Some([0; 3]),
            })
        );
        let other = read(&path, 7).unwrap();
        assert_eq!(other.v2.unwrap().projection.as_deref(), Some("cubemap"));
        assert_eq!(other.v1, None);
    }

    /// Boxes as written by Google's `spatial-media` and cameras of VR180.
    #[test]
    fn the_half_ahead_is_told_from_other_parts() {
        let of_xml = |[width, left, height]: [u32; 3]| {
            let entries = [
                ("ProjectionType", "equirectangular".to_owned()),
                ("CroppedAreaImageWidthPixels", width.to_string()),
                ("CroppedAreaImageHeightPixels", height.to_string()),
                ("CroppedAreaLeftPixels", left.to_string()),
                ("FullPanoWidthPixels", "5760".to_owned()),
                ("FullPanoHeightPixels", "2880".to_owned()),
            ];
            let entries = entries
                .map(|(name, value)| format!("<GSpherical:{name}>{value}</GSpherical:{name}>"));
            v1_statement(&entries.concat()).unwrap().extent
        };
        let of_box = |bounds: [u32; 4]| {
            let equi = [&[0; 4][..], &bounds.map(u32::to_be_bytes).concat()].concat();
            let proj = boxed(*b"proj", &boxed(*b"equi", &equi));
            let (_temp, path) = written(&track(1, &[], &boxed(*b"sv3d", &proj)));
            read(&path, 1).unwrap().v2.unwrap().extent
        };
        let quarter = 0x4000_0000;
        assert_eq!(of_xml([2880, 1440, 2880]), Extent::FrontHalf);
        assert_eq!(of_box([0, 0, quarter, quarter]), Extent::FrontHalf);
        assert_eq!(of_xml([5760, 0, 2880]), Extent::Whole);
        assert_eq!(of_box([0; 4]), Extent::Whole);
        for part in [
            of_xml([2880, 0, 2880]),
            of_xml([2880, 1440, 1440]),
            of_xml([5760, 0, 1440]),
        ] {
            assert_eq!(part, Extent::Part);
        }
        assert_eq!(of_box([quarter, 0, quarter, quarter]), Extent::Part);
        assert_eq!(of_box([0, 0, 2 * quarter, 0]), Extent::Part);
    }

    #[test]
    fn turns_are_read_as_they_are_stated() {
        let of_xml = |entries: &[(&str, &str)]| {
            let entries = entries.iter().map(|(axis, value)| {
                let name = format!("GSpherical:InitialView{axis}Degrees");
                format!("<{name}>{value}</{name}>")
            });
            v1_statement(&entries.collect::<String>()).unwrap().turn
        };
        assert_eq!(of_xml(&[]), None);
        assert_eq!(
            of_xml(&[("Heading", "-90"), ("Roll", " 0.25 ")]),
            Some([-90 << 16, 0, 1 << 14])
        );
        for nonsense in ["NaN", "inf", "ahead", ""] {
            assert_eq!(of_xml(&[("Pitch", nonsense)]), None, "{nonsense}");
        }
        assert_eq!(of_xml(&[("Pitch", "1e300")]), Some([0, i32::MAX, 0]));
        let of_header = |header: &[u8]| {
            let proj = boxed(*b"proj", &boxed(*b"prhd", header));
            let (_temp, path) = written(&track(1, &[], &boxed(*b"sv3d", &proj)));
            read(&path, 1).unwrap().v2.unwrap().turn
        };
        let numbers = [33 << 16, -(1 << 15), i32::MIN];
        let header = [&[0; 4][..], &numbers.map(i32::to_be_bytes).concat()].concat();
        assert_eq!(of_header(&header), Some(numbers));
        assert_eq!(of_header(&header[..15]), None);
    }

    /// Reading ends for any bytes.
    #[test]
    fn malformed_files_give_nothing() {
        for file in [
            vec![],
            vec![0; 7],
            vec![0; 4096],
            vec![255; 64],
            boxed(
                *b"moov",
                &[0, 0, 0, 1, b't', b'r', b'a', b'k', 255, 255, 255, 255],
            ),
            boxed(*b"moov", &boxed(*b"trak", &boxed(*b"uuid", &V1_UUID[..7]))),
        ] {
            let temp = tempfile::tempdir().unwrap();
            let path = temp.path().join("clip.mp4");
            std::fs::write(&path, &file).unwrap();
            assert_eq!(read(&path, 1).unwrap(), SphericalBoxes::default());
        }
    }
}
