//! The compressed PLY of `PlayCanvas` and `SuperSplat`.
//!
//! ```text
//! chunk    f32 x 18 for each 256 Gaussians: least and largest places, log sizes and colours
//! vertex   u32 place 11 10 11 bits    u32 rotation 2 10 10 10    u32 log sizes 11 10 11    u32 rgb, opacity 8 8 8 8
//! sh       u8 x 9, 24 or 45: 256 (c / 8 + 1/2), all of red, then green, then blue
//! ```
//!
//! Values are shares of the way between the chunk's bounds, first values in the highest bits. A rotation is the number of
//! the quaternion's largest value (of w, x, y, z), then the others as `q / sqrt(2) + 1/2`. Older files have no bounds of
//! colours, which lie between 0 and 1 then. Gaussians are ordered along a curve through space, so that chunks are small.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{f32::consts::FRAC_1_SQRT_2, fmt::Write, path::Path};

use omnilife_engine::{
    gaussians::{ActivatedGaussians, MAX_SH_DEGREE, SH_C0, sh_rest_count},
    parameters::ParameterTable,
};
use omnilife_schemas::{records::InvalidGaussians, store::StoreError};

use super::{exchange::FileRows, ranges::ValueRanges, validity::FileGaussian};
use crate::{error::ReconstructError, seeds::points::morton_code};

/// Gaussians of a chunk.
const CHUNK: usize = 256;
/// Bounds of a chunk; those of colours come last.
const BOUNDS: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
const PACKED: [&str; 4] = [
    "packed_position",
    "packed_rotation",
    "packed_scale",
    "packed_color",
];
/// Maximum log size, as in other writers.
const MOST_LOG_SIZE: f32 = 20.0;
/// Values that it holds.
pub(super) const RANGES: ValueRanges = ValueRanges {
    log_sizes: -MOST_LOG_SIZE..=MOST_LOG_SIZE,
    harmonics: -4.0..=4.0,
    ..ValueRanges::ALL
};

/// Minimum and maximum values of three columns in a chunk.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    least: [f32; 3],
    largest: [f32; 3],
}

impl Bounds {
    fn of(rows: &[[f32; 3]]) -> Self {
        let fold = |from: f32, choose: fn(f32, f32) -> f32| {
            rows.iter().fold([from; 3], |bound, row| {
                let [a, b, c] = bound;
                let [x, y, z] = *row;
                [choose(a, x), choose(b, y), choose(c, z)]
            })
        };
        Self {
            least: fold(f32::INFINITY, f32::min),
            largest: fold(f32::NEG_INFINITY, f32::max),
        }
    }

    /// Applies a function to each column's bounds and a value.
    fn each(&self, row: [f32; 3], function: impl Fn(f32, f32, f32) -> f32) -> [f32; 3] {
        let ([a, b, c], [d, e, f], [x, y, z]) = (self.least, self.largest, row);
        [function(a, d, x), function(b, e, y), function(c, f, z)]
    }

    /// Returns values as shares of the way between the bounds.
    fn shares(&self, row: [f32; 3]) -> [f32; 3] {
        self.each(row, |least, largest, value| {
            if largest > least {
                ((value - least) / (largest - least)).clamp(0.0, 1.0)
            } else {
                0.0
            }
        })
    }

    /// Undoes [`Bounds::shares`].
    fn values(&self, shares: [f32; 3]) -> [f32; 3] {
        self.each(shares, |least, largest, share| {
            least * (1.0 - share) + largest * share
        })
    }
}

/// Returns the largest number of so many bits.
fn most(bits: u32) -> u32 {
    (1_u32 << bits).wrapping_sub(1)
}

/// Appends a share in so many bits.
fn with_share(word: u32, bits: u32, share: f32) -> u32 {
    let most = most(bits) as f32;
    word << bits | (share * most).round().clamp(0.0, most) as u32
}

/// Returns the share in so many bits above the lowest `shift`.
fn share(word: u32, shift: u32, bits: u32) -> f32 {
    (word >> shift & most(bits)) as f32 / most(bits) as f32
}

/// Packs three shares in 11, 10 and 11 bits.
fn packed(shares: [f32; 3]) -> u32 {
    let [a, b, c] = shares;
    with_share(with_share(with_share(0, 11, a), 10, b), 11, c)
}

fn unpacked(word: u32) -> [f32; 3] {
    [share(word, 21, 11), share(word, 11, 10), share(word, 0, 11)]
}

/// Packs a unit quaternion (w, x, y, z).
fn packed_rotation(quaternion: [f32; 4]) -> u32 {
    let (mut largest, mut value) = (0, 0.0_f32);
    for (number, part) in quaternion.iter().enumerate() {
        if part.abs() > value.abs() {
            (largest, value) = (number, *part);
        }
    }
    let sign = if value < 0.0 { -1.0 } else { 1.0 };
    let others = quaternion
        .iter()
        .enumerate()
        .filter(|(number, _)| *number != largest);
    others.fold(largest as u32, |word, (_, part)| {
        with_share(word, 10, sign * part * FRAC_1_SQRT_2 + 0.5)
    })
}

fn unpacked_rotation(word: u32) -> [f32; 4] {
    let largest = word >> 30;
    let mut others = [20, 10, 0]
        .into_iter()
        .map(|shift| (share(word, shift, 10) - 0.5) / FRAC_1_SQRT_2);
    let mut quaternion = [0, 1, 2, 3].map(|number| {
        if number == largest {
            0.0
        } else {
            others.next().unwrap_or(0.0)
        }
    });
    let squares: f32 = quaternion.iter().map(|part| part * part).sum();
    if let Some(part) = quaternion.get_mut(largest as usize) {
        *part = (1.0 - squares).max(0.0).sqrt();
    }
    quaternion
}

/// Writes Gaussians.
#[expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "the order is one of the Gaussians that are there, with as many coefficients as their degree has"
)]
pub(super) fn write(gaussians: &ActivatedGaussians) -> Result<Vec<u8>, String> {
    let mut order: Vec<usize> = (0..gaussians.len()).collect();
    order.sort_by_cached_key(|&index| morton_code(gaussians.positions[index]));
    let mut bytes = header(order.len(), gaussians.sh_degree).into_bytes();
    let mut words: Vec<u32> = Vec::new();
    for chunk in order.chunks(CHUNK) {
        let rows = |of: &dyn Fn(usize) -> [f32; 3]| -> Vec<[f32; 3]> {
            chunk.iter().map(|&index| of(index)).collect()
        };
        let columns = [
            rows(&|index| gaussians.positions[index]),
            rows(&|index| {
                gaussians.scales[index].map(|scale| scale.ln().clamp(-MOST_LOG_SIZE, MOST_LOG_SIZE))
            }),
            rows(&|index| gaussians.sh_constant[index].map(|value| 0.5 + SH_C0 * value)),
        ];
        let bounds = columns.each_ref().map(|rows| Bounds::of(rows));
        for Bounds { least, largest } in bounds {
            let values = [least, largest];
            let values = values.as_flattened().iter();
            bytes.extend(values.flat_map(|value| value.to_le_bytes()));
        }
        for (row, &index) in chunk.iter().enumerate() {
            let [place, size, colour] = [0, 1, 2].map(|at| bounds[at].shares(columns[at][row]));
            let colour = colour
                .iter()
                .fold(0, |word, share| with_share(word, 8, *share));
            words.extend([
                packed(place),
                packed_rotation(gaussians.rotations[index]),
                packed(size),
                with_share(colour, 8, gaussians.opacities[index]),
            ]);
        }
    }
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    let rest = sh_rest_count(gaussians.sh_degree);
    for index in order {
        let coefficients = &gaussians.sh_rest[rest * index..rest * (index + 1)];
        for channel in 0..3 {
            bytes.extend(coefficients.iter().map(|rgb| {
                (256.0 * (rgb[channel] / 8.0 + 0.5))
                    .floor()
                    .clamp(0.0, 255.0) as u8
            }));
        }
    }
    Ok(bytes)
}

fn header(len: usize, degree: usize) -> String {
    let mut text = "ply\nformat binary_little_endian 1.0\n".to_owned();
    let mut element = |name: &str, count: usize, kind: &str, properties: &[&str]| {
        // Into a string, which takes everything.
        let _ = writeln!(text, "element {name} {count}");
        for property in properties {
            let _ = writeln!(text, "property {kind} {property}");
        }
    };
    element("chunk", len.div_ceil(CHUNK), "float", &BOUNDS);
    element("vertex", len, "uint", &PACKED);
    if degree > 0 {
        let names = harmonic_names(degree);
        element(
            "sh",
            len,
            "uchar",
            &names.iter().map(String::as_str).collect::<Vec<_>>(),
        );
    }
    text + "end_header\n"
}

fn harmonic_names(degree: usize) -> Vec<String> {
    let count = sh_rest_count(degree).saturating_mul(3);
    (0..count)
        .map(|number| format!("f_rest_{number}"))
        .collect()
}

/// Returns true if bytes begin as a compressed PLY: the first element of the header is a chunk.
pub(super) fn is_compressed(bytes: &[u8]) -> bool {
    let head = bytes.get(..4096).unwrap_or(bytes);
    let mut lines = head.split(|byte| *byte == b'\n');
    let is_ply = lines.next().is_some_and(|line| line.trim_ascii() == b"ply");
    let element = lines.find(|line| line.starts_with(b"element "));
    is_ply && element.is_some_and(|line| line.starts_with(b"element chunk "))
}

/// An element of a header.
struct Element<'a> {
    name: &'a str,
    count: usize,
    /// Types and names.
    properties: Vec<[&'a str; 2]>,
}

impl Element<'_> {
    /// Returns true if its properties are these, all of a type.
    fn has(&self, kind: &str, names: &[impl AsRef<str>]) -> bool {
        let expected = names.iter().map(|name| [kind, name.as_ref()]);
        self.properties.iter().copied().eq(expected)
    }
}

/// Returns the elements of a header, and the rest of the bytes.
fn parsed(bytes: &[u8]) -> Result<(Vec<Element<'_>>, &[u8]), String> {
    const END: &[u8] = b"\nend_header\n";
    let end = bytes.windows(END.len()).position(|window| window == END);
    let (text, rest) = end
        .and_then(|end| bytes.split_at_checked(end))
        .ok_or("is cut off in its header")?;
    let body = rest.get(END.len()..).unwrap_or_default();
    let text = std::str::from_utf8(text).map_err(|_| "its PLY header is not ASCII")?;
    let mut elements: Vec<Element<'_>> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match (words.as_slice(), elements.last_mut()) {
            (["format", format, ..], _) if *format != "binary_little_endian" => {
                return Err(format!(
                    "is a compressed PLY in {format}, which is not supported"
                ));
            }
            (["element", name, count], _) => elements.push(Element {
                name,
                count: count
                    .parse()
                    .map_err(|_| format!("its number of {name} is not a number"))?,
                properties: Vec::new(),
            }),
            (["property", kind, name], Some(element)) => element.properties.push([kind, name]),
            _ => {}
        }
    }
    Ok((elements, body))
}

/// Arrays of a file, one row per chunk or Gaussian.
struct Arrays<'a> {
    chunks: &'a [u8],
    has_colour_bounds: bool,
    words: &'a [u8],
    harmonics: &'a [u8],
    len: usize,
    degree: usize,
}

impl<'a> Arrays<'a> {
    fn find(bytes: &'a [u8]) -> Result<Self, String> {
        let (elements, body) = parsed(bytes)?;
        let (chunk, vertex, sh) = match elements.as_slice() {
            [chunk, vertex] => (chunk, vertex, None),
            [chunk, vertex, sh] => (chunk, vertex, Some(sh)),
            _ => return Err("must be a compressed PLY of chunk, vertex and sh".to_owned()),
        };
        let named = [Some(chunk), Some(vertex), sh];
        let expected = ["chunk", "vertex", "sh"];
        if let Some((element, expected)) = (named.into_iter().flatten().zip(expected))
            .find(|(element, expected)| element.name != *expected)
        {
            return Err(format!(
                "has an element {} in place of {expected}",
                element.name
            ));
        }
        let has_colour_bounds = chunk.has("float", &BOUNDS);
        let is_known = has_colour_bounds || chunk.has("float", BOUNDS.get(..12).unwrap_or(&BOUNDS));
        if !is_known || !vertex.has("uint", &PACKED) {
            return Err("has other properties than a compressed PLY".to_owned());
        }
        let degree = match sh {
            None => 0,
            Some(sh) => (1..=MAX_SH_DEGREE)
                .find(|degree| sh.has("uchar", &harmonic_names(*degree)))
                .ok_or("has harmonics of no degree from 1 to 3")?,
        };
        let len = vertex.count;
        if chunk.count != len.div_ceil(CHUNK) || sh.is_some_and(|sh| sh.count != len) {
            return Err(format!("has {} chunks for {len} Gaussians", chunk.count));
        }
        let mut rest = body;
        let mut array = |count: usize, width: usize| -> Result<&'a [u8], String> {
            let wanted = count.saturating_mul(width);
            let available = rest.len();
            let (array, others) = rest.split_at_checked(wanted).ok_or_else(|| {
                format!("is cut off: {available} bytes are left for an array of {wanted}")
            })?;
            rest = others;
            Ok(array)
        };
        let floats = chunk.properties.len().saturating_mul(4);
        Ok(Self {
            chunks: array(chunk.count, floats)?,
            has_colour_bounds,
            words: array(len, 16)?,
            harmonics: array(len, sh_rest_count(degree).saturating_mul(3))?,
            len,
            degree,
        })
    }

    /// Returns the bounds of positions, log sizes and colours of each chunk.
    fn bounds(&self) -> Vec<[Bounds; 3]> {
        let width = if self.has_colour_bounds { 18 } else { 12 };
        let floats = self.chunks.as_chunks::<4>().0;
        let chunks = floats.chunks_exact(width);
        let of_chunk = |chunk: &[[u8; 4]]| {
            let mut three = chunk.as_chunks::<3>().0.iter();
            let mut next = || three.next().map(|three| three.map(f32::from_le_bytes));
            [(); 3].map(|()| Bounds {
                least: next().unwrap_or([0.0; 3]),
                largest: next().unwrap_or([1.0; 3]),
            })
        };
        chunks.map(of_chunk).collect()
    }
}

/// Reads Gaussians in units of the file; `path` names it.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let arrays = Arrays::find(bytes).map_err(malformed)?;
    let mut gathered = FileRows::new(path, arrays.len, arrays.degree, invalid)?;
    let rest = sh_rest_count(arrays.degree);
    let rows = arrays
        .words
        .as_chunks::<4>()
        .0
        .chunks(4usize.saturating_mul(CHUNK));
    // Gaussians without harmonics have empty rows.
    let mut harmonics = arrays.harmonics.chunks_exact(rest.saturating_mul(3).max(1));
    for ([places, sizes, colours], words) in arrays.bounds().iter().zip(rows) {
        for row in words.as_chunks::<4>().0 {
            let [place, rotation, size, colour] = row.map(u32::from_le_bytes);
            let opacity = f64::from(share(colour, 0, 8));
            let shares = [24, 16, 8].map(|shift| share(colour, shift, 8));
            let gaussian = FileGaussian {
                position: places.values(unpacked(place)).map(f64::from),
                log_scales: sizes.values(unpacked(size)).map(f64::from),
                opacity_logit: (opacity / (1.0 - opacity)).ln(),
                quaternion: unpacked_rotation(rotation).map(f64::from),
            };
            let constant = colours.values(shares).map(|value| (value - 0.5) / SH_C0);
            let row = harmonics.next().unwrap_or_default();
            let channel = |number: usize| row.iter().skip(rest.saturating_mul(number));
            let channels = channel(0).zip(channel(1)).zip(channel(2)).take(rest);
            let coefficients: Vec<[f32; 3]> = channels
                .map(|((red, green), blue)| [*red, *green, *blue].map(harmonic))
                .collect();
            gathered
                .push(&gaussian, constant, &coefficients)
                .map_err(malformed)?;
        }
    }
    Ok(gathered.into_table())
}

/// Returns the middle of a step, and the ends of the range at both ends, as other readers do.
fn harmonic(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        byte => (f32::from(byte) + 0.5) / 256.0,
    };
    8.0 * (share - 0.5)
}

#[cfg(test)]
mod tests;
