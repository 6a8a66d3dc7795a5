//! Formats of Gaussians of other programs: one list for exports, renderings and help.
//!
//! A new one needs a file with its writer and reader, and a line in [`SPLAT_FORMATS`]. Writers get Gaussians with
//! x to the right, y down and z forward, and readers return them so.

use std::{fs, path::Path};

use glam::{DQuat, DVec3};
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians,
        static_gaussians::{self, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_REST},
    },
    parameters::{ArrayShape, ParameterTable, memory},
};
use omnilife_schemas::{
    Similarity,
    names::{self, UnknownName},
    records::InvalidGaussians,
    store::StoreError,
};

use super::{
    axes::HarmonicTurn,
    compressed_ply, glb, ply,
    ranges::ValueRanges,
    sog,
    splat::{self, Placement, SplatRow},
    spz,
    validity::{self, FileGaussian},
};
use crate::error::ReconstructError;

/// A file to read, with its placement and the requested coordinates.
struct FileToRead<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    placement: &'a Placement,
    normalization: &'a Similarity,
}

/// A format.
#[derive(Debug)]
pub struct SplatFormat {
    /// Its name on the command line.
    pub name: &'static str,
    /// End of the names of its files.
    pub ending: &'static str,
    /// Rounded values, with their steps.
    pub rounded: &'static str,
    /// True for viewers with the limits of the first ones: of `.splat` alone.
    pub is_for_old_viewers: bool,
    /// Values that its files hold.
    pub ranges: ValueRanges,
    /// Writes Gaussians; an error gives the reason in one line if the format cannot hold them.
    pub write: fn(&ActivatedGaussians) -> Result<Vec<u8>, String>,
    read: fn(&FileToRead<'_>, &mut InvalidGaussians) -> Result<ParameterTable, ReconstructError>,
}

/// All formats; the first is the default.
pub const SPLAT_FORMATS: &[SplatFormat] = &[
    SplatFormat {
        name: "splat",
        ending: ".splat",
        rounded: "colour, opacity and rotation to 8 bits a value; no harmonics",
        is_for_old_viewers: true,
        ranges: ValueRanges::ALL,
        write: |gaussians| {
            let rows = (0..gaussians.len()).map(|index| SplatRow::of(gaussians, index));
            Ok(splat::ordered(&rows.collect::<Vec<_>>()).into_flattened())
        },
        read: |file, invalid| {
            let FileToRead { path, bytes, .. } = file;
            Ok(splat::from_bytes(
                path,
                bytes,
                file.placement,
                file.normalization,
                invalid,
            )?)
        },
    },
    SplatFormat {
        name: "ply",
        ending: ".ply",
        rounded: "nothing",
        is_for_old_viewers: false,
        ranges: ValueRanges::ALL,
        write: |gaussians| ply::to_bytes(&table(gaussians), &UNCHANGED),
        read: |file, invalid| {
            if *file.placement == Placement::WORLD {
                // Doubles of a file far from the origin are normalized as doubles.
                return ply::from_bytes(file.path, file.bytes, file.normalization, invalid);
            }
            file.placed(ply::from_bytes(file.path, file.bytes, &UNCHANGED, invalid)?)
        },
    },
    SplatFormat {
        name: "compressed-ply",
        ending: ".compressed.ply",
        rounded: "positions, log sizes and colours to 11, 10, 11 and 8 bits between the bounds of 256 Gaussians, rotations \
                  to 10 bits a value, opacity to 8 bits, harmonics to 1/32",
        is_for_old_viewers: false,
        ranges: compressed_ply::RANGES,
        write: compressed_ply::write,
        read: |file, invalid| file.placed(compressed_ply::read(file.path, file.bytes, invalid)?),
    },
    SplatFormat {
        name: "spz",
        ending: ".spz",
        rounded: "positions to 24 bits, log sizes to 1/16, colour and opacity to 8 bits, rotations to 10 bits a value, \
                  harmonics to 5 and 4 bits",
        is_for_old_viewers: false,
        ranges: spz::RANGES,
        write: spz::write,
        read: |file, invalid| file.placed(spz::read(file.path, file.bytes, invalid)?),
    },
    // For programs that read no later version.
    SplatFormat {
        name: "spz-3",
        ending: ".v3.spz",
        rounded: "as in `spz`",
        is_for_old_viewers: false,
        ranges: spz::RANGES,
        write: spz::write_version_3,
        read: |file, invalid| file.placed(spz::read(file.path, file.bytes, invalid)?),
    },
    SplatFormat {
        name: "sog",
        ending: ".sog",
        rounded: "logarithms of positions to 16 bits, log sizes and colours to 256 values, opacity and rotations to 8 \
                  bits a value, harmonics to a palette of 1024 to 65,536 rows of 256 values",
        is_for_old_viewers: false,
        ranges: ValueRanges::ALL,
        write: sog::write,
        read: |file, invalid| file.placed(sog::read(file.path, file.bytes, invalid)?),
    },
    SplatFormat {
        name: "glb",
        ending: ".glb",
        rounded: "nothing but to floats",
        is_for_old_viewers: false,
        ranges: ValueRanges::ALL,
        write: glb::write,
        read: |file, invalid| file.placed(glb::read(file.path, file.bytes, invalid)?),
    },
];

/// Coordinates of a file, unchanged.
const UNCHANGED: Similarity = Similarity::new([0.0; 3], 1.0);

/// Returns the format of a name.
///
/// # Errors
/// [`UnknownName`] for an unknown name.
pub fn by_name(name: &str) -> Result<&'static SplatFormat, UnknownName> {
    names::find("format", name, SPLAT_FORMATS, |format| format.name)
}

/// Beginnings of files, with the name of their format.
const BEGINNINGS: [(&[u8], &str); 5] = [
    (b"ply", "ply"),
    (b"NGSP", "spz"),
    // The stream of earlier versions.
    (b"\x1f\x8b", "spz"),
    (b"PK\x03\x04", "sog"),
    (b"glTF", "glb"),
];

/// Returns the format of a file: that of its ending or, under another name, of its beginning. The header distinguishes
/// the two kinds of PLY. The record of a SOG stands for the folder that it lies in.
///
/// # Errors
/// For a file that neither of them tells.
fn of_file(path: &Path, bytes: &[u8]) -> Result<&'static SplatFormat, StoreError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.to_ascii_lowercase();
    let is_of = |format: &&SplatFormat| match format.name {
        // Any bytes are rows of it, those of a renamed PLY too.
        "splat" => {
            let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n");
            name.ends_with(format.ending) && !is_ply
        }
        "compressed-ply" => compressed_ply::is_compressed(bytes),
        "sog" => name.ends_with(format.ending) || name == sog::RECORD_FILE,
        _ => name.ends_with(format.ending),
    };
    // A compressed file may end as an ordinary one does, which stands before it.
    let named = SPLAT_FORMATS.iter().rev().find(is_of);
    let by_beginning = || {
        let mut known = BEGINNINGS.iter();
        let (_, name) = known.find(|(beginning, _)| bytes.starts_with(beginning))?;
        by_name(name).ok()
    };
    named.or_else(by_beginning).ok_or_else(|| {
        let endings: Vec<&str> = SPLAT_FORMATS.iter().map(|format| format.ending).collect();
        let reason = format!(
            "is not of a known format of Gaussians, by its name or its beginning; known are {}",
            endings.join(", ")
        );
        StoreError::malformed(path, reason)
    })
}

/// Reads static Gaussians into normalized coordinates of the world; invalid values are repaired or left out, and
/// counted in `invalid`.
///
/// # Errors
/// When the file cannot be read, is not of its format, or would not fit into memory.
pub fn read(
    path: &Path,
    placement: &Placement,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    from_bytes(path, &bytes, placement, normalization, invalid)
}

/// Reads a file's bytes like [`read`]; `path` names the file and its format.
///
/// # Errors
/// Those of [`read`].
pub fn from_bytes(
    path: &Path,
    bytes: &[u8],
    placement: &Placement,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let file = FileToRead {
        path,
        bytes,
        placement,
        normalization,
    };
    (of_file(path, bytes)?.read)(&file, invalid)
}

/// Returns a world point to keep the positions of a file around in 32-bit floats: that of [`ply::origin`], and
/// the origin for other formats, which hold floats alone.
///
/// # Errors
/// When the file cannot be read, is of no known format, or is a malformed PLY.
pub fn origin(path: &Path) -> Result<DVec3, ReconstructError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    if of_file(path, &bytes)?.name == "ply" {
        ply::origin(path, &bytes)
    } else {
        Ok(DVec3::ZERO)
    }
}

impl FileToRead<'_> {
    /// Moves Gaussians from the file's coordinates to normalized ones of the world.
    fn placed(&self, mut table: ParameterTable) -> Result<ParameterTable, ReconstructError> {
        let (placement, normalization) = (self.placement, self.normalization);
        let back = placement.rotation.inverse();
        for place in table.arrays[POSITIONS].values.as_chunks_mut::<3>().0 {
            let world = placement.to_world(DVec3::from_array(place.map(f64::from)));
            *place = normalization.normalize(world).as_vec3().to_array();
        }
        let log_unit = (normalization.scale / placement.scale).ln();
        for log in &mut table.arrays[LOG_SCALES].values {
            *log = (f64::from(*log) + log_unit) as f32;
        }
        if placement.rotation != DQuat::IDENTITY {
            for quaternion in table.arrays[QUATERNIONS].values.as_chunks_mut::<4>().0 {
                let [w, x, y, z] = quaternion.map(f64::from);
                let turned = back * DQuat::from_xyzw(x, y, z, w);
                *quaternion = [turned.w, turned.x, turned.y, turned.z].map(|part| part as f32);
            }
            let turn = HarmonicTurn::new(back);
            let degree = static_gaussians::sh_degree(&table);
            if degree > 0 {
                let rest = &mut table.arrays[SH_REST];
                for row in rest.values.chunks_exact_mut(rest.width) {
                    turn.apply(row.as_chunks_mut().0);
                }
            }
        }
        let mut values = table.arrays.iter().flat_map(|array| &array.values);
        if values.all(|value| value.is_finite()) {
            Ok(table)
        } else {
            let reason = "lies outside of what 32-bit floats hold, where its record places it";
            Err(StoreError::malformed(self.path, reason).into())
        }
    }
}

fn table(gaussians: &ActivatedGaussians) -> ParameterTable {
    let mut table = ParameterTable::new(gaussians.len());
    let logs = gaussians
        .scales
        .as_flattened()
        .iter()
        .map(|scale| scale.ln());
    let mut columns = [
        gaussians.positions.as_flattened().to_vec(),
        logs.collect(),
        gaussians.rotations.as_flattened().to_vec(),
        (gaussians.opacities.iter())
            .map(|&opacity| static_gaussians::logit(opacity))
            .collect(),
        gaussians.sh_constant.as_flattened().to_vec(),
        gaussians.sh_rest.as_flattened().to_vec(),
    ]
    .into_iter();
    for ArrayShape { name, width } in static_gaussians::shapes(gaussians.sh_degree) {
        table.add(name, width, columns.next().unwrap_or_default(), 0.0);
    }
    table
}

/// Gaussians on their way from a file into a table, in the file's units.
pub(super) struct FileRows<'a> {
    shapes: Vec<ArrayShape>,
    arrays: Vec<Vec<f32>>,
    read: u64,
    invalid: &'a mut InvalidGaussians,
}

impl<'a> FileRows<'a> {
    /// Starts a table of `len` Gaussians with harmonics of a degree. The file holds that many: its size was
    /// checked.
    pub(super) fn new(
        path: &Path,
        len: usize,
        degree: usize,
        invalid: &'a mut InvalidGaussians,
    ) -> Result<Self, ReconstructError> {
        require(path, len as u64, degree)?;
        let shapes = static_gaussians::shapes(degree);
        let arrays = shapes.iter();
        Ok(Self {
            arrays: arrays
                .map(|shape| Vec::with_capacity(shape.width.saturating_mul(len)))
                .collect(),
            shapes,
            read: 0,
            invalid,
        })
    }

    /// Adds a valid Gaussian with its coefficients of the constant and the other harmonics.
    pub(super) fn push(
        &mut self,
        given: &FileGaussian,
        sh_constant: [f32; 3],
        sh_rest: &[[f32; 3]],
    ) -> Result<(), String> {
        let number = self.read;
        self.read = number.saturating_add(1);
        let colours = || sh_constant.iter().chain(sh_rest.as_flattened());
        for (what, is_sound) in [
            ("place", given.position.iter().all(|value| !value.is_nan())),
            (
                "size",
                given.log_scales.iter().all(|log| *log < f64::INFINITY),
            ),
            ("opacity", !given.opacity_logit.is_nan()),
            (
                "rotation",
                given.quaternion.iter().all(|part| part.is_finite()),
            ),
            ("colour", colours().all(|value| value.is_finite())),
        ] {
            if !is_sound {
                return Err(format!(
                    "{what} of Gaussian {number} is not a finite number"
                ));
            }
        }
        let Some(gaussian) = validity::valid(given, self.invalid) else {
            return Ok(());
        };
        let float = |value: f64| value as f32;
        let values: [&[f32]; 6] = [
            &gaussian.position.map(float),
            &gaussian.log_scales.map(float),
            &gaussian.quaternion.map(float),
            &[float(gaussian.opacity_logit)],
            &sh_constant,
            sh_rest.as_flattened(),
        ];
        for (array, values) in self.arrays.iter_mut().zip(values) {
            array.extend(values);
        }
        Ok(())
    }

    pub(super) fn into_table(self) -> ParameterTable {
        let kept = self.arrays.get(OPACITY_LOGITS).map_or(0, Vec::len);
        let mut table = ParameterTable::new(kept);
        for (shape, values) in self.shapes.iter().zip(self.arrays) {
            table.add(shape.name, shape.width, values, 0.0);
        }
        table
    }
}

/// Refuses an empty file, and a number of Gaussians that does not fit into memory.
pub(super) fn require(path: &Path, len: u64, degree: usize) -> Result<(), ReconstructError> {
    if len == 0 {
        return Err(StoreError::malformed(path, "holds no Gaussians").into());
    }
    crate::process::require(
        memory::table_bytes(len, &static_gaussians::shapes(degree)),
        &format!("{}: {len} Gaussians", path.display()),
    )
}

#[cfg(test)]
pub(super) mod tests;
