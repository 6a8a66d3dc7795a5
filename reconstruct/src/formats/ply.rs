//! Gaussians as the PLY that 3DGS writes and its viewers read.
//!
//! Properties as in 3DGS `scene/gaussian_model.py` `save_ply`: x y z, nx ny nz (zero), `f_dc_*`,
//! `f_rest_*` (all coefficients of red, then green, then blue), opacity (logit), `scale_*`
//! (logarithm), `rot_*` (w, x, y, z). Coordinates are the scene's own: the normalization is undone.
//! It does not rotate, so spherical harmonics and quaternions stay as they are. All properties are
//! `float`, but x, y and z of a scene so far from the origin that floats would lose it, which are `double`.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs, io::Write, path::Path};

use glam::{DVec3, Vec3};
use omnilife_schemas::{
    Similarity,
    points::{Coordinates, PlyTable},
    store::{self, StoreError},
};

use crate::error::ReconstructError;
use omnilife_engine::parameters::memory;
use omnilife_engine::{
    gaussians::{
        MAX_SH_DEGREE, sh_rest_count,
        static_gaussians::{
            self, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT, SH_REST,
        },
    },
    parameters::ParameterTable,
};

/// Names of the properties of Gaussians of a degree, in the order in which they are written.
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

/// Writes static Gaussians, whole or not at all.
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

/// [`write()`] with `further` properties at the end, whose values `push` adds for each Gaussian.
pub(super) fn write_with(
    path: &Path,
    table: &ParameterTable,
    normalization: &Similarity,
    further: &[String],
    push: impl Fn(usize, &mut Vec<f32>),
) -> Result<(), StoreError> {
    let degree = static_gaussians::sh_degree(table);
    let log_unit = normalization.scale.ln() as f32;
    let coordinates = Coordinates::around(normalization);
    store::write_with(path, |writer| {
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
    })
}

/// The properties of one Gaussian behind its position.
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

/// Reads static Gaussians into normalized coordinates. Normals and properties that 3DGS does not
/// write are passed over.
///
/// # Errors
/// When the file is missing, malformed or truncated, lacks a property, holds a value that is not
/// finite, or would not fit into memory.
pub fn read(path: &Path, normalization: &Similarity) -> Result<ParameterTable, ReconstructError> {
    read_with(path, normalization, &[]).map(|(table, _)| table)
}

/// [`read`] with `further` properties, one column each.
#[expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "rows hold the columns that were looked up, as many as the degree has; their number was checked"
)]
pub(super) fn read_with(
    path: &Path,
    normalization: &Similarity,
    further: &[String],
) -> Result<(ParameterTable, Vec<Vec<f32>>), ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let ply = PlyTable::parse(&bytes).map_err(malformed)?;
    let degree = stored_degree(&ply).map_err(malformed)?;
    let shapes = static_gaussians::shapes(degree);
    crate::process::require(
        memory::table_bytes(ply.len() as u64, &shapes),
        &format!("{}: {} Gaussians", path.display(), ply.len()),
    )?;
    let columns = properties(degree)
        .iter()
        .filter(|name| !name.starts_with('n'))
        .chain(further)
        .map(|name| {
            let missing = || format!("has no property {name}: not Gaussians of 3DGS");
            ply.column(name).ok_or_else(missing)
        })
        .collect::<Result<Vec<usize>, String>>()
        .map_err(malformed)?;
    let log_unit = normalization.scale.ln();
    let rest = sh_rest_count(degree);
    let mut arrays: Vec<Vec<f32>> = shapes
        .iter()
        .map(|shape| Vec::with_capacity(shape.width * ply.len()))
        .collect();
    let mut columns_of_further = vec![Vec::with_capacity(ply.len()); further.len()];
    let mut values = Vec::with_capacity(columns.len());
    ply.for_each_row(|index, row| {
        values.clear();
        values.extend(columns.iter().map(|&column| row[column]));
        let row = values.as_slice();
        if let Some(bad) = row.iter().position(|value| !value.is_finite()) {
            let name = ply.names().nth(columns[bad]).unwrap_or_default();
            return Err(format!("{name} of Gaussian {index} is not finite"));
        }
        let (geometry, others) = row.split_at(3);
        let (colour, others) = others.split_at(3 + 3 * rest);
        let position = normalization.normalize(DVec3::from_slice(geometry));
        arrays[POSITIONS].extend(position.as_vec3().to_array());
        let float = |value: &f64| *value as f32;
        arrays[SH_CONSTANT].extend(colour[..3].iter().map(float));
        for coefficient in 0..rest {
            let channels = (0..3).map(|channel| colour[3 + channel * rest + coefficient] as f32);
            arrays[SH_REST].extend(channels);
        }
        arrays[OPACITY_LOGITS].push(others[0] as f32);
        let log_scales = others[1..4].iter().map(|value| (value + log_unit) as f32);
        arrays[LOG_SCALES].extend(log_scales);
        arrays[QUATERNIONS].extend(others[4..8].iter().map(float));
        for (column, value) in columns_of_further.iter_mut().zip(&others[8..]) {
            column.push(*value as f32);
        }
        Ok(())
    })
    .map_err(malformed)?;
    let mut table = ParameterTable::new(ply.len());
    for (shape, values) in shapes.iter().zip(arrays) {
        table.add(shape.name, shape.width, values, 0.0);
    }
    Ok((table, columns_of_further))
}

/// A world point to keep the positions of a PLY around in 32-bit floats: the origin, or their median
/// where floats would lose them around the origin.
///
/// # Errors
/// When the file is missing, malformed or truncated.
pub fn origin(path: &Path) -> Result<DVec3, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let ply = PlyTable::parse(&bytes).map_err(malformed)?;
    let columns = ["x", "y", "z"].map(|name| ply.column(name));
    let mut places = Vec::with_capacity(ply.len());
    ply.for_each_row(|_, row| {
        // What is missing is named when the Gaussians are read.
        let at = |column: Option<usize>| column.and_then(|column| row.get(column)).copied();
        places.push(DVec3::from_array(
            columns.map(|column| at(column).unwrap_or(f64::NAN)),
        ));
        Ok(())
    })
    .map_err(malformed)?;
    let around = Similarity::from_median(&places).filter(|around| !around.fits_f32());
    Ok(around.map_or(DVec3::ZERO, |around| DVec3::from_array(around.offset)))
}

/// Degree of the harmonics by the number of `f_rest_*` properties.
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
mod tests {
    use omnilife_schemas::points::PointCloud;

    use super::*;
    use omnilife_engine::gaussians::static_gaussians::InitialGaussians;

    const NORMALIZATION: Similarity = Similarity {
        offset: [10.0, 20.0, 30.0],
        scale: 0.5,
    };

    fn table(sh_degree: usize) -> ParameterTable {
        let initial = InitialGaussians::isotropic(
            vec![[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]],
            &[0.25, 2.0],
            vec![[0.5; 3], [0.1, 0.2, 0.3]],
            vec![0.5, 0.9],
        );
        let mut table = static_gaussians::table(&initial, sh_degree);
        if let Some(rest) = table.arrays.get_mut(SH_REST) {
            for (index, value) in rest.values.iter_mut().enumerate() {
                *value = index as f32;
            }
        }
        table
    }

    #[test]
    fn exports_world_coordinates() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        write(&path, &table(0), &NORMALIZATION)?;
        let positions = PointCloud::read_ply(&path)?.positions;
        assert_eq!(positions[0], [12.0, 24.0, 36.0]);
        let bytes = fs::read(&path)?;
        let rows = &bytes[bytes.len() - 2 * properties(0).len() * 4..];
        let scale = f32::from_le_bytes(rows.as_chunks::<4>().0[10]).exp();
        assert!(
            (scale - 0.5).abs() < 1e-6,
            "a quarter unit is half a world unit: {scale}"
        );
        Ok(())
    }

    #[test]
    fn coefficients_are_written_channel_by_channel() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        write(&path, &table(1), &NORMALIZATION)?;
        let bytes = fs::read(&path)?;
        let names = properties(1);
        assert_eq!(names[9..18].join(" "), {
            let rest: Vec<String> = (0..9).map(|index| format!("f_rest_{index}")).collect();
            rest.join(" ")
        });
        let rows = bytes[bytes.len() - 2 * names.len() * 4..]
            .as_chunks::<4>()
            .0;
        let rest: Vec<f32> = rows[9..18].iter().map(|&w| f32::from_le_bytes(w)).collect();
        assert_eq!(rest, [0.0, 3.0, 6.0, 1.0, 4.0, 7.0, 2.0, 5.0, 8.0]);
        Ok(())
    }

    #[test]
    fn what_is_written_is_read_back() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        for degree in 0..=3 {
            let written = table(degree);
            write(&path, &written, &NORMALIZATION)?;
            let read = read(&path, &NORMALIZATION)?;
            for (a, b) in written.arrays.iter().zip(&read.arrays) {
                assert_eq!((a.name, a.width), (b.name, b.width));
                let error = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs());
                assert!(error.fold(0.0, f32::max) < 1e-5, "{} at {degree}", a.name);
            }
        }
        Ok(())
    }

    /// Wherever a scene lies; the file's positions are floats near the origin, as everybody reads them.
    #[test]
    fn runs_far_from_the_origin_are_read_back() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        let written = table(1);
        for (offset, scale, kind) in [
            ([0.0; 3], 0.01, "float"),
            ([-70.0, 3.0, 0.0], 0.5, "float"),
            ([5e5, 5e6, 0.0], 0.2, "double"),
            ([4.2e6, 1.7e5, -4.8e6], 3.0, "double"),
        ] {
            let normalization = Similarity { offset, scale };
            write(&path, &written, &normalization)?;
            let bytes = fs::read(&path)?;
            let header = String::from_utf8_lossy(&bytes[..200]).into_owned();
            assert!(header.contains(&format!("property {kind} z\nproperty float nx")));
            let read = read(&path, &normalization)?;
            for (a, b) in written.arrays.iter().zip(&read.arrays) {
                let error = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs());
                assert!(error.fold(0.0, f32::max) < 1e-5, "{} at {offset:?}", a.name);
            }
            let origin = origin(&path)?;
            let middle = DVec3::from_array(offset);
            if kind == "float" {
                assert_eq!(origin, DVec3::ZERO);
            } else {
                assert!(origin.distance(middle) < 10.0 / scale, "{origin}");
            }
        }
        Ok(())
    }

    #[test]
    fn what_is_missing_is_named() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        write(&path, &table(1), &NORMALIZATION)?;
        let whole = fs::read(&path)?;
        let refused = |bytes: Vec<u8>| -> Result<String, Box<dyn std::error::Error>> {
            fs::write(&path, bytes)?;
            Ok(read(&path, &NORMALIZATION)
                .map(drop)
                .expect_err("refused")
                .to_string())
        };
        let renamed = |from: &[u8], to: &[u8]| {
            assert_eq!(from.len(), to.len());
            let place = whole.windows(from.len()).position(|window| window == from);
            let mut bytes = whole.clone();
            let place = place.expect("the name is there");
            bytes[place..place + from.len()].copy_from_slice(to);
            bytes
        };
        assert!(refused(renamed(b"rot_3", b"rotor"))?.contains("has no property rot_3"));
        assert!(refused(renamed(b"opacity", b"opaqueX"))?.contains("has no property opacity"));
        assert!(refused(renamed(b"f_rest_8", b"g_rest_8"))?.contains("8 f_rest properties"));
        let mut nan = whole.clone();
        let last = nan.len() - 4;
        nan[last..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(refused(nan)?.contains("rot_3 of Gaussian 1 is not finite"));
        assert!(refused(whole[..whole.len() - 1].to_vec())?.contains("ends after 1 of 2"));
        // A count that no file of this size holds must not make us allocate it.
        let many = renamed(b"vertex 2\n", b"vertex 9\n");
        assert!(refused(many)?.contains("ends after 2 of 9"));
        Ok(())
    }
}
