//! SPZ, the compressed Gaussians of Niantic (github.com/nianticlabs/spz): 3 and 4 are written, 2 to 4 are read.
//!
//! ```text
//! u32 magic   u32 version   u32 Gaussians   u8 degree   u8 fractional bits   u8 flags   u8 0
//! positions    24-bit fixed point x 3      opacities     u8, of 255
//! colours      u8 x 3, 255 (0.15 c + 1/2)  log sizes     u8 x 3, 16 (log + 10)
//! rotations    u32, or u8 x 3 in version 2 harmonics     u8 x 3 each, 128 c + 128
//! ```
//!
//! Each line is an array over all Gaussians. Versions up to 3 are one gzip stream. In version 4 a header of 32 bytes
//! and a table of sizes come first, and each array is a Zstandard stream. Axes are x right, y up, z back.
//! A rotation is the quaternion's three smallest values, in their order among x, y, z, w. The number of the
//! largest has 2 bits. Each value has a sign and 9 bits, of 511 for the square root of 1/2.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    f32::consts::FRAC_1_SQRT_2,
    io::{self, Read, Write},
    path::Path,
};

use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use omnilife_engine::{
    gaussians::{ActivatedGaussians, MAX_SH_DEGREE, sh_rest_count},
    parameters::ParameterTable,
};
use omnilife_schemas::{records::InvalidGaussians, store::StoreError};

use super::{
    axes::HalfTurn,
    exchange::{self, FileRows},
    ranges::ValueRanges,
    validity::FileGaussian,
};
use crate::error::ReconstructError;

const MAGIC: [u8; 4] = *b"NGSP";
const HEADER_BYTES: usize = 16;
/// Bytes of the header of version 4.
const LONG_HEADER_BYTES: usize = 32;
/// Level of the streams of version 4: near the best of Zstandard, at a second for a million Gaussians.
const ZSTD_LEVEL: i32 = 12;
/// Bytes of a stream in the table of version 4: its sizes compressed and not.
const STREAM_ENTRY_BYTES: usize = 16;
/// Flag of Gaussians that were trained with anti-aliasing.
const IS_ANTIALIASED: u8 = 1;
/// Flag of extensions behind the header.
const HAS_EXTENSIONS: u8 = 2;
/// The extension of Adobe that bounds the orbit of a camera; it does not affect Gaussians.
const SAFE_ORBIT: u32 = 0xADBE_0002;
const COLOUR_SCALE: f32 = 0.15;
/// Values that bytes hold.
pub(super) const RANGES: ValueRanges = ValueRanges {
    log_sizes: -10.0..=255.0 / 16.0 - 10.0,
    constants: -0.5 / COLOUR_SCALE..=0.5 / COLOUR_SCALE,
    harmonics: -1.0..=1.0,
};
/// Largest coordinate in steps.
const MOST_STEPS: f64 = 8_388_607.0;
/// Maximum number of fractional bits: programs shift 32-bit integers by them.
const MOST_FRACTIONAL_BITS: u8 = 23;
/// Bits of a small value of a rotation, but its sign.
const SMALL_BITS: u32 = 9;
const SMALL_WIDTH: u32 = SMALL_BITS + 1;
const SMALL_MOST: u32 = (1 << SMALL_BITS) - 1;

/// Writes Gaussians in version 4.
pub(super) fn write(gaussians: &ActivatedGaussians) -> Result<Vec<u8>, String> {
    let bits = fractional_bits(gaussians)?;
    let mut arrays = Vec::from(arrays(gaussians, bits));
    arrays.retain(|array| !array.is_empty());
    let mut bytes = header(gaussians, 4, bits, arrays.len() as u8)?;
    bytes.extend((LONG_HEADER_BYTES as u32).to_le_bytes());
    bytes.resize(LONG_HEADER_BYTES, 0);
    let mut streams = Vec::new();
    for array in &arrays {
        let stream = zstd::bulk::compress(array, ZSTD_LEVEL).map_err(|error| error.to_string())?;
        bytes.extend((stream.len() as u64).to_le_bytes());
        bytes.extend((array.len() as u64).to_le_bytes());
        streams.extend(stream);
    }
    bytes.extend(streams);
    Ok(bytes)
}

/// Writes Gaussians in version 3.
pub(super) fn write_version_3(gaussians: &ActivatedGaussians) -> Result<Vec<u8>, String> {
    let bits = fractional_bits(gaussians)?;
    let header = header(gaussians, 3, bits, 0)?;
    let compressed = || -> io::Result<Vec<u8>> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&header)?;
        for array in arrays(gaussians, bits) {
            encoder.write_all(&array)?;
        }
        encoder.finish()
    };
    compressed().map_err(|error| error.to_string())
}

fn header(
    gaussians: &ActivatedGaussians,
    version: u32,
    fractional_bits: u8,
    streams: u8,
) -> Result<Vec<u8>, String> {
    let len = u32::try_from(gaussians.len()).map_err(|_| "SPZ counts Gaussians in 32 bits")?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(len.to_le_bytes());
    bytes.extend([gaussians.sh_degree as u8, fractional_bits, 0, streams]);
    Ok(bytes)
}

/// Returns the arrays over all Gaussians, in the order of the file.
fn arrays(gaussians: &ActivatedGaussians, fractional_bits: u8) -> [Vec<u8>; 6] {
    let turn = HalfTurn::ABOUT_X;
    let steps = f64::from(fractional_bits).exp2();
    let fixed = |value: f32| {
        let [a, b, c, _] = ((f64::from(value) * steps).round() as i32).to_le_bytes();
        [a, b, c]
    };
    let places = gaussians.positions.iter();
    let colours = gaussians.sh_constant.as_flattened().iter();
    let scales = gaussians.scales.as_flattened().iter();
    let rotations = gaussians.rotations.iter();
    let signs = turn.harmonics();
    let signs = signs.iter().take(sh_rest_count(gaussians.sh_degree));
    let harmonics = gaussians.sh_rest.iter().zip(signs.enumerate().cycle());
    [
        places
            .flat_map(|place| turn.place(*place).map(fixed))
            .flatten()
            .collect(),
        (gaussians.opacities.iter())
            .map(|opacity| byte(255.0 * opacity))
            .collect(),
        colours
            .map(|value| byte(255.0 * (COLOUR_SCALE * value + 0.5)))
            .collect(),
        scales
            .map(|scale| byte(16.0 * (scale.ln() + 10.0)))
            .collect(),
        rotations
            .flat_map(|rotation| packed(turn.rotation(*rotation)).to_le_bytes())
            .collect(),
        harmonics
            .flat_map(|(coefficient, (number, sign))| {
                // Five bits of degree 1 and four of the others, as in other writers.
                let step = if number < 3 { 8.0 } else { 16.0 };
                coefficient.map(|value| {
                    let value = 128.0 * sign * value;
                    byte(step * (value / step).round() + 128.0)
                })
            })
            .collect(),
    ]
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Returns the bits that the largest coordinate leaves.
fn fractional_bits(gaussians: &ActivatedGaussians) -> Result<u8, String> {
    let places = gaussians.positions.as_flattened().iter();
    let farthest = places
        .map(|place| f64::from(place.abs()))
        .fold(0.0, f64::max);
    (0..=MOST_FRACTIONAL_BITS)
        .rev()
        .find(|&bits| (farthest * f64::from(bits).exp2()).round() <= MOST_STEPS)
        .ok_or_else(|| {
            format!("reaches {farthest:.0} units from the origin, and SPZ holds {MOST_STEPS}")
        })
}

/// Packs a unit quaternion (w, x, y, z).
fn packed(quaternion: [f32; 4]) -> u32 {
    let [w, x, y, z] = quaternion;
    let values = [x, y, z, w];
    let (mut largest, mut size) = (0, 0.0);
    for (number, value) in values.iter().enumerate() {
        if value.abs() > size {
            (largest, size) = (number, value.abs());
        }
    }
    // A quaternion and its opposite are one rotation: the largest value is positive.
    let is_turned = values.get(largest).is_some_and(|value| *value < 0.0);
    let small = values
        .iter()
        .enumerate()
        .filter(|(number, _)| *number != largest);
    small.fold(largest as u32, |bits, (_, value)| {
        let is_negative = (*value < 0.0) != is_turned;
        let share = value.abs() / FRAC_1_SQRT_2 * SMALL_MOST as f32;
        let magnitude = (share.round() as u32).min(SMALL_MOST);
        bits << SMALL_WIDTH | u32::from(is_negative) << SMALL_BITS | magnitude
    })
}

/// Unpacks a quaternion (w, x, y, z).
fn unpacked(bits: u32) -> [f32; 4] {
    let largest = bits >> 30;
    let mut small = [20, 10, 0].into_iter().map(|shift| {
        let bits = bits >> shift;
        let value = FRAC_1_SQRT_2 * (bits & SMALL_MOST) as f32 / SMALL_MOST as f32;
        if bits >> SMALL_BITS & 1 == 1 {
            -value
        } else {
            value
        }
    });
    let mut values = [0, 1, 2, 3].map(|number| {
        if number == largest {
            0.0
        } else {
            small.next().unwrap_or(0.0)
        }
    });
    let others: f32 = values.iter().map(|value| value * value).sum();
    if let Some(value) = values.get_mut(largest as usize) {
        *value = (1.0 - others).max(0.0).sqrt();
    }
    let [x, y, z, w] = values;
    [w, x, y, z]
}

/// Unpacks a quaternion (w, x, y, z) of version 2.
fn of_three_bytes(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|byte| f32::from(byte) / 127.5 - 1.0);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    [w, x, y, z]
}

#[derive(Debug, Clone, Copy)]
struct Header {
    version: u32,
    len: usize,
    degree: usize,
    fractional_bits: u8,
    flags: u8,
    /// Number of streams of version 4.
    streams: u8,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (words, rest) = bytes.as_chunks::<4>();
        let (&[magic, version, len, fields], []) = (words, rest) else {
            return Err("is cut off in its header".to_owned());
        };
        let version = u32::from_le_bytes(version);
        let [degree, fractional_bits, flags, streams] = fields;
        if magic != MAGIC {
            return Err("is not an SPZ: its header does not begin with NGSP".to_owned());
        }
        if !(2..=4).contains(&version) {
            return Err(format!("is SPZ of version {version}, and 2 to 4 are read"));
        }
        if usize::from(degree) > MAX_SH_DEGREE {
            return Err(format!(
                "has harmonics of degree {degree}, and {MAX_SH_DEGREE} is the highest that is read"
            ));
        }
        if fractional_bits > 30 {
            return Err(format!("has {fractional_bits} fractional bits of 24"));
        }
        Ok(Self {
            version,
            len: u32::from_le_bytes(len) as usize,
            degree: usize::from(degree),
            fractional_bits,
            flags,
            streams,
        })
    }

    /// Returns the bytes of a Gaussian in each array.
    fn widths(&self) -> [usize; 6] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        let harmonics = sh_rest_count(self.degree).saturating_mul(3);
        [9, 1, 3, 3, rotation, harmonics]
    }
}

/// Reads Gaussians in units of the file; `path` names it.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let is_plain = bytes.starts_with(&MAGIC);
    let mut stream = GzDecoder::new(bytes);
    let header = if is_plain {
        Header::parse(bytes.get(..HEADER_BYTES).unwrap_or_default())
    } else {
        decoded(&mut stream, HEADER_BYTES).and_then(|header| Header::parse(&header))
    }
    .map_err(malformed)?;
    if is_plain != (header.version == 4) {
        let reason = format!(
            "is SPZ of version {} in the container of another",
            header.version
        );
        return Err(malformed(reason).into());
    }
    // Arrays are decoded into memory: the size in the header has to fit before.
    exchange::require(path, header.len as u64, header.degree)?;
    invalid.is_antialiased |= header.flags & IS_ANTIALIASED != 0;
    let arrays = if is_plain {
        streams(bytes, &header)
    } else if header.flags & HAS_EXTENSIONS == 0 {
        one_stream(&mut stream, &header)
    } else {
        Err("has extensions between its header and its Gaussians, which are not read".to_owned())
    };
    gathered(path, &header, &arrays.map_err(malformed)?, invalid)
}

/// Decodes `count` bytes of a stream.
fn decoded(stream: &mut dyn Read, count: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let read = stream.take(count as u64).read_to_end(&mut bytes);
    let read = read.map_err(|error| format!("cannot be decompressed: {error}"))?;
    if read == count {
        Ok(bytes)
    } else {
        Err(format!("is cut off: an array of {count} bytes has {read}"))
    }
}

/// Refuses a stream that goes on, is cut off behind its last byte, or has another checksum.
fn finished(stream: &mut dyn Read) -> Result<(), String> {
    match stream.read(&mut [0]) {
        Ok(0) => Ok(()),
        Ok(_) => Err("goes on behind its Gaussians".to_owned()),
        Err(error) => Err(format!("cannot be decompressed: {error}")),
    }
}

/// Decodes the arrays of versions before 4, behind their header.
fn one_stream(stream: &mut dyn Read, header: &Header) -> Result<Vec<Vec<u8>>, String> {
    let mut arrays = Vec::new();
    for width in header.widths() {
        arrays.push(decoded(stream, width.saturating_mul(header.len))?);
    }
    finished(stream)?;
    Ok(arrays)
}

/// Decodes the arrays of version 4.
fn streams(bytes: &[u8], header: &Header) -> Result<Vec<Vec<u8>>, String> {
    let cut_off = || "is cut off in its table of streams".to_owned();
    let word = |at: usize| -> Option<u32> {
        let word = bytes.get(at..)?.first_chunk()?;
        Some(u32::from_le_bytes(*word))
    };
    let table_at = word(HEADER_BYTES).ok_or_else(cut_off)? as usize;
    if header.flags & HAS_EXTENSIONS != 0 {
        let zone = bytes.get(LONG_HEADER_BYTES..table_at).ok_or_else(cut_off)?;
        check_extensions(zone)?;
    }
    let table = bytes.get(table_at..).ok_or_else(cut_off)?;
    let table_bytes = usize::from(header.streams).saturating_mul(STREAM_ENTRY_BYTES);
    let (table, mut rest) = table.split_at_checked(table_bytes).ok_or_else(cut_off)?;
    let mut entries = table.as_chunks::<8>().0.as_chunks::<2>().0.iter();
    let mut arrays = Vec::new();
    for width in header.widths() {
        let count = width.saturating_mul(header.len);
        let entry = entries.next();
        if count == 0 && entry.is_none() {
            arrays.push(Vec::new());
            continue;
        }
        let [size, decoded_size] = entry
            .ok_or_else(|| format!("has {} streams, too few", header.streams))?
            .map(u64::from_le_bytes);
        if decoded_size != count as u64 {
            return Err(format!(
                "has a stream of {decoded_size} bytes in place of {count}"
            ));
        }
        let size = usize::try_from(size).map_err(|_| cut_off())?;
        let (stream, others) = rest
            .split_at_checked(size)
            .ok_or("is cut off in its streams")?;
        rest = others;
        if count == 0 {
            arrays.push(Vec::new());
            continue;
        }
        let mut decoder = zstd::Decoder::with_buffer(stream)
            .map_err(|error| format!("cannot be decompressed: {error}"))?;
        arrays.push(decoded(&mut decoder, count)?);
        finished(&mut decoder)?;
    }
    Ok(arrays)
}

/// Refuses extensions that may change the meaning of the arrays: those for coordinates and for harmonics do.
fn check_extensions(mut zone: &[u8]) -> Result<(), String> {
    let cut_off = || "is cut off in its extensions".to_owned();
    while !zone.is_empty() {
        let (head, rest) = zone.split_at_checked(8).ok_or_else(cut_off)?;
        let &[kind, size] = head.as_chunks::<4>().0 else {
            return Err(cut_off());
        };
        let kind = u32::from_le_bytes(kind);
        if kind != SAFE_ORBIT {
            return Err(format!("has extension {kind:#010x}, which is not read"));
        }
        let size = u32::from_le_bytes(size) as usize;
        zone = rest.get(size..).ok_or_else(cut_off)?;
    }
    Ok(())
}

fn gathered(
    path: &Path,
    header: &Header,
    arrays: &[Vec<u8>],
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let mut gathered = FileRows::new(path, header.len, header.degree, invalid)?;
    let turn = HalfTurn::ABOUT_X;
    let signs = turn.harmonics();
    let step = f64::from(header.fractional_bits).exp2().recip();
    let mut rows = arrays
        .iter()
        .zip(header.widths())
        // An array without bytes has empty rows.
        .map(|(array, width)| array.chunks_exact(width.max(1)))
        .collect::<Vec<_>>();
    let mut harmonics = Vec::with_capacity(sh_rest_count(header.degree));
    for _ in 0..header.len {
        let mut next = rows.iter_mut().map(|rows| rows.next().unwrap_or_default());
        let mut row = || next.next().unwrap_or_default();
        let (place, opacity, colour, size) = (row(), row(), row(), row());
        let (rotation, rest) = (row(), row());
        let rotation = match *rotation {
            [x, y, z] => of_three_bytes([x, y, z]),
            [a, b, c, d] => unpacked(u32::from_le_bytes([a, b, c, d])),
            _ => return Err(malformed("is cut off".to_owned()).into()),
        };
        let three = |values: &[u8]| values.first_chunk::<3>().copied().unwrap_or_default();
        let mut coordinates = place.as_chunks::<3>().0.iter();
        let place = [(); 3].map(|()| {
            let [a, b, c] = coordinates.next().copied().unwrap_or_default();
            // The sign extends into the fourth byte.
            let fixed = i32::from_le_bytes([0, a, b, c]) >> 8;
            (f64::from(fixed) * step) as f32
        });
        let opacity = f64::from(opacity.first().copied().unwrap_or_default()) / 255.0;
        harmonics.clear();
        harmonics.extend(
            rest.as_chunks::<3>()
                .0
                .iter()
                .zip(signs)
                .map(|(rgb, sign)| rgb.map(|byte| sign * (f32::from(byte) - 128.0) / 128.0)),
        );
        let gaussian = FileGaussian {
            position: turn.place(place).map(f64::from),
            log_scales: three(size).map(|byte| f64::from(byte) / 16.0 - 10.0),
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
            quaternion: turn.rotation(rotation).map(f64::from),
        };
        let colour = three(colour).map(|byte| (f32::from(byte) / 255.0 - 0.5) / COLOUR_SCALE);
        gathered
            .push(&gaussian, colour, &harmonics)
            .map_err(malformed)?;
    }
    Ok(gathered.into_table())
}

#[cfg(test)]
mod tests;
