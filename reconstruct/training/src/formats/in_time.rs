//! Gaussians in time: an open format of closed forms, which `docs/reference/gaussians-in-time.md` specifies.
//!
//! * `header`: the JSON. `arrays`: quantized arrays. `tracks`: rigid objects.
//! * `written`: closed forms of a model. `decoded`: a file's Gaussians. `played`: their motions, for rendering.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod arrays;
mod decoded;
mod header;
mod played;
#[cfg(test)]
mod tests;
mod tracks;
mod written;

use std::{
    fs,
    io::{Read, Write},
    path::Path,
    sync::Arc,
};

use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use glam::{DQuat, DVec3};
use omnilife_engine::{
    clock::TimeSpan,
    gaussians::static_gaussians,
    model::{Model, Part},
    parameters::memory,
};
use omnilife_schemas::{Similarity, records::InvalidGaussians, store::StoreError};

use self::{
    decoded::DecodedPart,
    header::{FORMAT, Frame, Header, PartHeader, Time, Units, VERSION},
    played::PlayedGaussians,
    tracks::{quaternion, wxyz},
    written::PartWriter,
};
use super::splat::Placement;
use crate::{error::ReconstructError, process};

/// Name of the format on the command line.
pub const NAME: &str = "gtime";
/// End of the names of its files.
pub const ENDING: &str = ".gtime";

const MAGIC: &[u8; 8] = b"GAUSTIME";
const MOST_HEADER_BYTES: usize = 64 << 20;
/// Up in files of this program.
const UP: [f64; 3] = [0.0, -1.0, 0.0];

/// Returns true for a file's name of this format.
pub fn is_named(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.to_ascii_lowercase().ends_with(ENDING)
}

/// Map from coordinates of one frame to another's: `factor turn x + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FrameTransform {
    factor: f64,
    turn: DQuat,
    shift: DVec3,
}

impl FrameTransform {
    /// Returns the map of positions.
    fn place(&self, place: DVec3) -> DVec3 {
        self.vector(place) + self.shift
    }

    /// Returns the map of velocities.
    fn vector(&self, vector: DVec3) -> DVec3 {
        self.turn * vector * self.factor
    }

    /// Returns the map of coordinates in an object's own axes: only units differ.
    fn of_objects(&self) -> Self {
        Self {
            factor: self.factor,
            turn: DQuat::IDENTITY,
            shift: DVec3::ZERO,
        }
    }
}

/// A file's bytes, with counts.
#[derive(Debug)]
pub struct WrittenInTime {
    /// The file.
    pub bytes: Vec<u8>,
    /// Number of Gaussians in it.
    pub gaussians: u64,
    /// Number of Gaussians that are left out because their opacity rounds to 0 in 8 bits.
    pub transparent: u64,
    /// Its place in the world.
    pub placement: Placement,
}

/// Returns a model in normalized coordinates as a file with this placement in the world. Gaussians that a file
/// cannot hold are counted in `invalid`.
///
/// # Errors
/// In one line, when a part of the model has no closed form in time, or no Gaussian is visible.
pub fn write(
    model: &Model,
    placement: &Placement,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<WrittenInTime, String> {
    let span = model.time_span().unwrap_or(TimeSpan {
        begin_seconds: 0.0,
        end_seconds: 0.0,
        frames: None,
    });
    let offset = DVec3::from_array(normalization.offset);
    let parts = model.parts.iter();
    let degrees = parts
        .clone()
        .map(|part| static_gaussians::sh_degree(&part.table));
    let degree = degrees.max().unwrap_or(0);
    let mut writer = PartWriter {
        placed: FrameTransform {
            factor: placement.scale / normalization.scale,
            turn: placement.rotation,
            shift: placement.rotation * (offset - placement.offset) * placement.scale,
        },
        span,
        degree,
        invalid,
        transparent: 0,
        bytes: Vec::new(),
    };
    let headers = parts.map(|part| writer.add(part));
    let parts: Vec<PartHeader> = headers
        .filter_map(Result::transpose)
        .collect::<Result<_, _>>()?;
    let header = Header {
        format: FORMAT.to_owned(),
        version: VERSION,
        generator: concat!("omnilife ", env!("CARGO_PKG_VERSION")).to_owned(),
        units: Units {
            length: "world".to_owned(),
            time: "second".to_owned(),
        },
        frame: Frame {
            up: UP,
            origin: placement.offset.to_array(),
            scale: placement.scale,
            rotation: wxyz(placement.rotation),
        },
        time: Time {
            begin: span.begin_seconds,
            seconds: span.end_seconds - span.begin_seconds,
            frames: span.frames,
        },
        degree,
        parts,
    };
    if header.parts.is_empty() {
        return Err("has no Gaussian that a viewer could draw".to_owned());
    }
    let bytes = file_bytes(&header, &writer.bytes).map_err(|error| error.to_string())?;
    Ok(WrittenInTime {
        bytes,
        gaussians: header.count(),
        transparent: writer.transparent,
        placement: *placement,
    })
}

/// Returns an existing file as it is.
///
/// # Errors
/// When the file cannot be read, or its header is malformed.
pub fn copy(path: &Path) -> Result<WrittenInTime, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    let (header, _) = split(&bytes).map_err(|reason| StoreError::malformed(path, reason))?;
    Ok(WrittenInTime {
        gaussians: header.count(),
        transparent: 0,
        placement: Placement {
            offset: DVec3::from_array(header.frame.origin),
            scale: header.frame.scale,
            rotation: quaternion(header.frame.rotation),
        },
        bytes,
    })
}

/// Puts a file together.
fn file_bytes(header: &Header, arrays: &[u8]) -> std::io::Result<Vec<u8>> {
    let json = serde_json::to_vec(header)?;
    let length = u32::try_from(json.len()).ok();
    let length = length.filter(|&length| length as usize <= MOST_HEADER_BYTES);
    let length = length.ok_or_else(|| std::io::Error::other("has a header of over 64 MiB"))?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend(json);
    let mut encoder = GzEncoder::new(bytes, Compression::default());
    encoder.write_all(arrays)?;
    encoder.finish()
}

/// Returns the header and the compressed arrays of a file.
fn split(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    let rest = bytes
        .strip_prefix(MAGIC)
        .ok_or("does not begin with GAUSTIME")?;
    let (length, rest) = rest
        .split_first_chunk()
        .ok_or("is cut off in its first bytes")?;
    let length = u32::from_le_bytes(*length) as usize;
    if length > MOST_HEADER_BYTES {
        return Err(format!("has a header of {length} bytes"));
    }
    let (json, arrays) = rest
        .split_at_checked(length)
        .ok_or("is cut off in its header")?;
    Ok((Header::parse(json)?, arrays))
}

/// Returns the world point at a file's origin, to keep positions around in 32-bit floats.
///
/// # Errors
/// When the file cannot be read, or is malformed.
pub fn origin(path: &Path) -> Result<DVec3, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    let (header, _) = split(&bytes).map_err(|reason| StoreError::malformed(path, reason))?;
    Ok(DVec3::from_array(header.frame.origin))
}

/// Reads a file into normalized coordinates of the world; invalid values are repaired or left out, and counted in
/// `invalid`.
///
/// # Errors
/// When the file cannot be read, is malformed, or would not fit into memory.
pub fn read(
    path: &Path,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<Model, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    from_bytes(path, &bytes, normalization, invalid)
}

/// Reads a file's bytes like [`read`]; `path` names the file.
///
/// # Errors
/// Those of [`read`].
pub fn from_bytes(
    path: &Path,
    bytes: &[u8],
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<Model, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let (header, compressed) = split(bytes).map_err(malformed)?;
    let count = header.count();
    // Arrays are decoded into memory: what the header says has to fit before.
    let shapes = static_gaussians::shapes(header.degree);
    let table = memory::table_bytes(count, &shapes).saturating_mul(2);
    process::require(
        table.saturating_add(header.array_bytes()),
        &format!("{}: {count} Gaussians", path.display()),
    )?;
    let arrays = inflated(compressed, header.array_bytes()).map_err(malformed)?;
    let Frame {
        origin,
        scale,
        rotation,
        ..
    } = header.frame;
    let turn = quaternion(rotation).normalize().inverse();
    let placed = FrameTransform {
        factor: normalization.scale / scale,
        turn,
        shift: normalization.normalize(DVec3::from_array(origin)),
    };
    let mut rest = &arrays[..];
    let mut parts = Vec::new();
    for (number, part) in header.parts.iter().enumerate() {
        let mut decoded = Vec::new();
        for array in &part.arrays {
            let bytes = usize::try_from(array.bytes(part.count)).ok();
            let split = bytes.and_then(|bytes| rest.split_at_checked(bytes));
            let (own, others) = split.ok_or_else(|| malformed("is cut off".to_owned()))?;
            rest = others;
            decoded.push((array.name.as_str(), array.decode(own)));
        }
        let part = DecodedPart {
            header: part,
            arrays: decoded,
        };
        let table = part
            .table(&placed, invalid)
            .map_err(|reason| malformed(format!("part {number} {reason}")))?;
        let played = PlayedGaussians {
            motion: Arc::new(part.motion(&placed)),
            time: header.time,
        };
        parts.push(Part::new(played, table));
    }
    Ok(Model::new(parts))
}

/// Decompresses exactly `count` bytes.
fn inflated(compressed: &[u8], count: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // A byte more tells a stream that goes on, and has the checksum compared.
    let read = GzDecoder::new(compressed)
        .take(count.saturating_add(1))
        .read_to_end(&mut bytes);
    let read = read.map_err(|error| format!("cannot be decompressed: {error}"))? as u64;
    match read.cmp(&count) {
        std::cmp::Ordering::Equal => Ok(bytes),
        std::cmp::Ordering::Less => Err(format!(
            "is cut off: its {count} bytes of arrays are {read}"
        )),
        std::cmp::Ordering::Greater => Err(format!("goes on behind its {count} bytes of arrays")),
    }
}
