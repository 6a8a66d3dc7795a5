//! Gaussians as the PLY that 3DGS writes and its viewers read.
//!
//! Properties as in 3DGS `scene/gaussian_model.py` `save_ply`: x y z, nx ny nz (zero), `f_dc_*`, `f_rest_*` (all
//! coefficients of red, then green, then blue), opacity (logit), `scale_*` (logarithm), `rot_*` (w, x, y, z).
//!
//! Coordinates are the scene's own: the normalization is undone. It does not rotate, so spherical harmonics and
//! quaternions stay as they are. All properties are `float`, except x, y and z of a scene so far from the origin
//! that floats would lose it, which are `double`. `validity` defines the valid values.
//!
//! A file of Mip-Splatting has its 3D filter as a property, which is applied (`smoothed`). Other properties beside those
//! of 3DGS are listed as unread.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    fs,
    io::{self, Write},
    path::Path,
};

use glam::{DVec3, Vec3};
use omnilife_schemas::{
    Similarity,
    points::{Coordinates, PlyTable},
    records::InvalidGaussians,
    store::{self, StoreError},
};

use super::validity::{self, ActivationCheck, FileGaussian};
use crate::error::ReconstructError;
use omnilife_engine::parameters::memory;
use omnilife_engine::{
    gaussians::{
        MAX_SH_DEGREE, sh_rest_count,
        static_gaussians::{
            self, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT, SH_REST,
        },
    },
    parameters::{ArrayShape, ParameterTable},
};

/// Property with the 3D filter of Mip-Splatting, a standard deviation in units of the file.
const FILTER: &str = "filter_3D";
/// Properties of programs that draw points, without effect on Gaussians.
const POINT_COLOURS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// Returns the names of the properties of Gaussians of a degree, in the order of the file.
#[expect(clippy::arithmetic_side_effects, reason = "degrees are 3 at most")]
fn properties(sh_degree: usize) -> Vec<String> {
    let rest = 3 * sh_rest_count(sh_degree);
    let numbered = |prefix: &str, count: usize| -> Vec<String> {
        (0..count).map(|index| format!("{prefix}{index}")).collect()
    };
    [
        ["x", "y", "z", "nx", "ny", "nz"].map(str::to_owned).into(),
        numbered("f_dc_", 3),
        numbered("f_rest_", rest),
        vec!["opacity".to_owned()],
        numbered("scale_", 3),
        numbered("rot_", 4),
    ]
    .concat()
}

/// Writes static Gaussians atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    table: &ParameterTable,
    normalization: &Similarity,
) -> Result<(), StoreError> {
    write_with(path, table, normalization, &[], |_, _| {})
}

/// Returns the bytes of a file of static Gaussians.
///
/// # Errors
/// The reason why they could not be written.
pub(super) fn to_bytes(
    table: &ParameterTable,
    normalization: &Similarity,
) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    write_to(&mut bytes, table, normalization, &[], |_, _| {})
        .map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// Writes like [`write()`], with `further` properties at the end, whose values `push` adds for each Gaussian.
pub(super) fn write_with(
    path: &Path,
    table: &ParameterTable,
    normalization: &Similarity,
    further: &[String],
    push: impl Fn(usize, &mut Vec<f32>),
) -> Result<(), StoreError> {
    store::write_with(path, |writer| {
        write_to(writer, table, normalization, further, push)
    })
}

fn write_to(
    writer: &mut dyn Write,
    table: &ParameterTable,
    normalization: &Similarity,
    further: &[String],
    push: impl Fn(usize, &mut Vec<f32>),
) -> io::Result<()> {
    let degree = static_gaussians::sh_degree(table);
    let log_unit = normalization.scale.ln() as f32;
    let coordinates = Coordinates::around(normalization);
    write!(
        writer,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        table.len()
    )?;
    for property in properties(degree).iter().chain(further) {
        let kind = match property.as_str() {
            "x" | "y" | "z" => coordinates.ply_type(),
            _ => "float",
        };
        writeln!(writer, "property {kind} {property}")?;
    }
    writeln!(writer, "end_header")?;
    let mut row = Vec::new();
    for index in 0..table.len() {
        let position = Vec3::from_slice(table.row(POSITIONS, index)).as_dvec3();
        coordinates.write(writer, &normalization.restore(position).to_array())?;
        row.clear();
        push_row(table, index, log_unit, &mut row);
        push(index, &mut row);
        for value in &row {
            writer.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}

/// Returns the properties of one Gaussian behind its position.
#[expect(clippy::indexing_slicing, reason = "colours have three channels")]
fn push_row(table: &ParameterTable, index: usize, log_unit: f32, row: &mut Vec<f32>) {
    let values = |array: usize| table.row(array, index);
    row.extend([0.0; 3]);
    row.extend(values(SH_CONSTANT));
    if static_gaussians::sh_degree(table) > 0 {
        let coefficients = values(SH_REST).as_chunks::<3>().0;
        for channel in 0..3 {
            row.extend(coefficients.iter().map(|rgb| rgb[channel]));
        }
    }
    row.extend(values(OPACITY_LOGITS));
    row.extend(values(LOG_SCALES).iter().map(|value| value - log_unit));
    row.extend(values(QUATERNIONS));
}

/// Reads static Gaussians into normalized coordinates. Normals and colours of points are ignored. `invalid` lists
/// properties that are not read, and counts invalid values, which are repaired or left out.
///
/// # Errors
/// When the file is missing, malformed or truncated, lacks a property, or would not fit into memory. When it
/// holds a value that is not finite and has no meaning.
pub fn read(
    path: &Path,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    read_with(path, normalization, &[], invalid).map(|(table, _)| table)
}

/// Reads a file's bytes like [`read`]; `path` names the file.
pub(super) fn from_bytes(
    path: &Path,
    bytes: &[u8],
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    parsed(path, bytes, normalization, &[], invalid).map(|(table, _)| table)
}

/// Reads like [`read`], with `further` properties, one column each.
pub(super) fn read_with(
    path: &Path,
    normalization: &Similarity,
    further: &[String],
    invalid: &mut InvalidGaussians,
) -> Result<(ParameterTable, Vec<Vec<f32>>), ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    parsed(path, &bytes, normalization, further, invalid)
}

fn parsed(
    path: &Path,
    bytes: &[u8],
    normalization: &Similarity,
    further: &[String],
    invalid: &mut InvalidGaussians,
) -> Result<(ParameterTable, Vec<Vec<f32>>), ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let ply = PlyTable::parse(bytes).map_err(malformed)?;
    let degree = stored_degree(&ply).map_err(malformed)?;
    crate::process::require(
        memory::table_bytes(ply.len() as u64, &static_gaussians::shapes(degree)),
        &format!("{}: {} Gaussians", path.display(), ply.len()),
    )?;
    let columns = columns(&ply, degree, further).map_err(malformed)?;
    let filter = ply.column(FILTER);
    invalid
        .unread_properties
        .extend(unread_properties(&ply, degree, further));
    let mut rows = Rows::new(degree, normalization, further.len(), ply.len());
    let mut values: Vec<f64> = Vec::with_capacity(columns.len());
    ply.for_each_row(|index, row| {
        values.clear();
        values.extend(
            columns
                .iter()
                .filter_map(|&column| row.get(column).copied()),
        );
        for (&value, &column) in values.iter().zip(&columns) {
            let name = || ply.names().nth(column).unwrap_or_default();
            if !(value as f32).is_finite() && !validity::has_meaning(name(), value) {
                return Err(format!("{} of Gaussian {index} is not finite", name()));
            }
        }
        let filter = filter.and_then(|column| row.get(column).copied());
        if filter.is_some_and(|size| !size.is_finite() || size < 0.0) {
            return Err(format!(
                "{FILTER} of Gaussian {index} must be a size of 0 or more"
            ));
        }
        rows.push(&values, filter, invalid);
        Ok(())
    })
    .map_err(malformed)?;
    invalid.looks_activated |= rows.activation.is_activated();
    Ok(rows.into_table())
}

/// Returns the positions of the properties that are read, in the order of [`properties`] without normals.
fn columns(ply: &PlyTable<'_>, degree: usize, further: &[String]) -> Result<Vec<usize>, String> {
    properties(degree)
        .iter()
        .filter(|name| !name.starts_with('n'))
        .chain(further)
        .map(|name| ply.column(name).ok_or_else(|| missing(ply, name)))
        .collect()
}

/// Returns the names of the properties that are neither read nor known to be without effect.
fn unread_properties(ply: &PlyTable<'_>, degree: usize, further: &[String]) -> Vec<String> {
    let read = properties(degree);
    let is_known = |name: &str| {
        name == FILTER
            || POINT_COLOURS.contains(&name)
            || read
                .iter()
                .chain(further)
                .any(|known| known.as_str() == name)
    };
    let names = ply.names().filter(|name| !is_known(name));
    names.map(str::to_owned).collect()
}

/// Returns a Gaussian as the 3D filter of Mip-Splatting leaves it: its variance is added along every axis, and the
/// opacity falls with the ratio of the volumes (`get_scaling_with_3D_filter` and `get_opacity_with_3D_filter` in
/// `scene/gaussian_model.py` of `autonomousvision/mip-splatting`). `size` is the filter's standard deviation.
fn smoothed(gaussian: &FileGaussian, size: f64) -> FileGaussian {
    let log_scales = gaussian
        .log_scales
        .map(|log| 0.5 * ((2.0 * log).exp() + size * size).ln());
    let growth: f64 = log_scales
        .iter()
        .zip(&gaussian.log_scales)
        .map(|(after, before)| after - before)
        .sum();
    let logit = gaussian.opacity_logit;
    // Logarithm of the sigmoid, finite for all logits.
    let log_opacity = logit.min(0.0) - (-logit.abs()).exp().ln_1p() - growth;
    let faded = log_opacity - (-log_opacity.exp()).ln_1p();
    FileGaussian {
        log_scales,
        // It is infinite if rounding leaves no fading.
        opacity_logit: faded.min(logit),
        ..*gaussian
    }
}

/// Returns the reason why a PLY without a property does not hold Gaussians: the kind of file, if it is
/// recognized.
fn missing(ply: &PlyTable<'_>, name: &str) -> String {
    let has = |name: &str| ply.column(name).is_some();
    if has("scale_1") && !has("scale_2") {
        "has scale_0 and scale_1 alone: 2D Gaussians, and only those of 3DGS are read".to_owned()
    } else if !has("scale_0") && !has("rot_0") {
        "has no scale_0 and no rot_0: a point cloud, not Gaussians of 3DGS".to_owned()
    } else {
        format!("has no property {name}: not Gaussians of 3DGS")
    }
}

/// The rows of a file on their way into a table.
struct Rows {
    normalization: Similarity,
    /// Coefficients beside the constant one, of each channel.
    rest: usize,
    shapes: Vec<ArrayShape>,
    arrays: Vec<Vec<f32>>,
    further: Vec<Vec<f32>>,
    activation: ActivationCheck,
}

#[expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "rows hold the columns that were looked up, as many as the degree has; their number was checked"
)]
impl Rows {
    fn new(degree: usize, normalization: &Similarity, further: usize, len: usize) -> Self {
        let shapes = static_gaussians::shapes(degree);
        let arrays = shapes.iter();
        Self {
            normalization: *normalization,
            rest: sh_rest_count(degree),
            arrays: arrays
                .map(|shape| Vec::with_capacity(shape.width * len))
                .collect(),
            shapes,
            further: vec![Vec::with_capacity(len); further],
            activation: ActivationCheck::default(),
        }
    }

    /// Adds a row, if it is valid, after the 3D filter of its file.
    fn push(&mut self, row: &[f64], filter: Option<f64>, invalid: &mut InvalidGaussians) {
        let (geometry, others) = row.split_at(3);
        let (colour, others) = others.split_at(3 + 3 * self.rest);
        let position = self.normalization.normalize(DVec3::from_slice(geometry));
        let given = FileGaussian {
            position: position.to_array(),
            log_scales: [1, 2, 3].map(|at| others[at]),
            opacity_logit: others[0],
            quaternion: [4, 5, 6, 7].map(|at| others[at]),
        };
        let Some(gaussian) = validity::valid(&given, invalid) else {
            return;
        };
        self.activation.add(&given);
        let gaussian = match filter {
            Some(size) if size > 0.0 => {
                invalid.smoothed += 1;
                smoothed(&gaussian, size)
            }
            _ => gaussian,
        };
        let float = |value: f64| value as f32;
        let log_unit = self.normalization.scale.ln();
        let arrays = &mut self.arrays;
        arrays[POSITIONS].extend(gaussian.position.map(float));
        arrays[LOG_SCALES].extend(gaussian.log_scales.map(|log| float(log + log_unit)));
        arrays[QUATERNIONS].extend(gaussian.quaternion.map(float));
        arrays[OPACITY_LOGITS].push(float(gaussian.opacity_logit));
        arrays[SH_CONSTANT].extend(colour[..3].iter().copied().map(float));
        for coefficient in 0..self.rest {
            let channels = (0..3).map(|channel| colour[3 + channel * self.rest + coefficient]);
            arrays[SH_REST].extend(channels.map(float));
        }
        for (column, value) in self.further.iter_mut().zip(&others[8..]) {
            column.push(*value as f32);
        }
    }

    fn into_table(self) -> (ParameterTable, Vec<Vec<f32>>) {
        let mut table = ParameterTable::new(self.arrays[OPACITY_LOGITS].len());
        for (shape, values) in self.shapes.iter().zip(self.arrays) {
            table.add(shape.name, shape.width, values, 0.0);
        }
        (table, self.further)
    }
}

/// Returns a world point to keep the positions of a PLY around in 32-bit floats: the origin, or their median
/// where floats would lose them around the origin. Invalid positions are left out. `path` names the file.
///
/// # Errors
/// When the file is malformed or truncated.
pub fn origin(path: &Path, bytes: &[u8]) -> Result<DVec3, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let ply = PlyTable::parse(bytes).map_err(malformed)?;
    let columns = ["x", "y", "z"].map(|name| ply.column(name));
    let mut places = Vec::with_capacity(ply.len());
    ply.for_each_row(|_, row| {
        // Missing properties are reported when the Gaussians are read.
        let at = |column: Option<usize>| column.and_then(|column| row.get(column)).copied();
        let place = columns.map(|column| at(column).unwrap_or(f64::NAN));
        // Not NaN either.
        if place.iter().all(|value| value.abs() <= validity::REACH) {
            places.push(DVec3::from_array(place));
        }
        Ok(())
    })
    .map_err(malformed)?;
    let around = Similarity::from_median(&places).filter(|around| !around.fits_f32());
    Ok(around.map_or(DVec3::ZERO, |around| DVec3::from_array(around.offset)))
}

/// Returns the degree of the harmonics by the number of `f_rest_*` properties.
#[expect(clippy::arithmetic_side_effects, reason = "degrees are 3 at most")]
fn stored_degree(ply: &PlyTable<'_>) -> Result<usize, String> {
    let count = ply
        .names()
        .filter(|name| name.starts_with("f_rest_"))
        .count();
    (0..=MAX_SH_DEGREE)
        .find(|&degree| 3 * sh_rest_count(degree) == count)
        .ok_or_else(|| {
            format!("has {count} f_rest properties; degrees 0 to 3 have 0, 9, 24 and 45")
        })
}

#[cfg(test)]
mod tests;
