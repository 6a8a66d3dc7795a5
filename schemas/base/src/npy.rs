//! Array files of `NumPy`, as far as poses and depth need them: f32 and f64, little-endian, C order
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).
//!
//! The crates for this format depend on a parser for Python literals, which a header of three known entries does not
//! need.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs, io::Write, path::Path};

use crate::{
    error_kind,
    store::{self, StoreError},
};

/// Array with its shape, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Length of every dimension.
    pub shape: Vec<usize>,
    /// Values in row-major order.
    pub values: Vec<f64>,
}

/// Writes an f32 array (format version 1.0).
///
/// # Errors
/// When the file cannot be written.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "the header is of our own making"
)]
pub fn write_f32(path: &Path, shape: &[usize], values: &[f32]) -> Result<(), StoreError> {
    let lengths: Vec<String> = shape.iter().map(ToString::to_string).collect();
    // A tuple of one needs its comma.
    let lengths = match &lengths[..] {
        [one] => format!("{one},"),
        several => several.join(", "),
    };
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({lengths}), }}");
    // Magic, version and length take 10 bytes; data begins at a multiple of 64.
    let padding = (64 - (10 + header.len() + 1) % 64) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    store::write_with(path, |writer| {
        writer.write_all(b"\x93NUMPY\x01\x00")?;
        writer.write_all(&(header.len() as u16).to_le_bytes())?;
        writer.write_all(header.as_bytes())?;
        for value in values {
            writer.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Reads an f32 or f64 array.
///
/// # Errors
/// When the file is missing, truncated or of another kind.
pub fn read(path: &Path) -> Result<Array, StoreError> {
    error_kind::reading(path);
    let bytes = fs::read(path).map_err(|error| StoreError::read(path, error))?;
    from_bytes(&bytes).map_err(|reason| StoreError::malformed(path, reason))
}

/// Reads an array as [`read`] does, from the bytes of a file.
///
/// # Errors
/// The fault of the bytes.
pub fn from_bytes(bytes: &[u8]) -> Result<Array, String> {
    let broken = || "not a NumPy array, or cut off".to_owned();
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(broken)?;
    let (header_length, rest) = match rest {
        [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        _ => return Err(broken()),
    };
    let (header, data) = rest.split_at_checked(header_length).ok_or_else(broken)?;
    let header = std::str::from_utf8(header).map_err(|_| broken())?;
    if !header.contains("'fortran_order': False") {
        return Err("the array is in Fortran order, or its header cannot be read".to_owned());
    }
    let shape = shape(header).ok_or_else(broken)?;
    let values: Vec<f64> = if header.contains("'<f4'") {
        let (words, rest) = data.as_chunks::<4>();
        no_rest(rest)?;
        words
            .iter()
            .map(|word| f64::from(f32::from_le_bytes(*word)))
            .collect()
    } else if header.contains("'<f8'") {
        let (words, rest) = data.as_chunks::<8>();
        no_rest(rest)?;
        words.iter().map(|word| f64::from_le_bytes(*word)).collect()
    } else {
        return Err("the array is not of little-endian f32 or f64".to_owned());
    };
    if Some(values.len()) != shape.iter().try_fold(1_usize, |all, &n| all.checked_mul(n)) {
        return Err(format!("{} values for shape {shape:?}", values.len()));
    }
    Ok(Array { shape, values })
}

fn no_rest(rest: &[u8]) -> Result<(), String> {
    if rest.is_empty() {
        return Ok(());
    }
    Err(format!("{} bytes behind its last value", rest.len()))
}

/// Returns the tuple after `'shape':`.
fn shape(header: &str) -> Option<Vec<usize>> {
    let (_, after) = header.split_once("'shape':")?;
    let (_, inner) = after.split_once('(')?;
    let (inner, _) = inner.split_once(')')?;
    inner
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok())
        .collect()
}
