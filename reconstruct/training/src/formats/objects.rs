//! The objects of a graph: their paths as a record, and their Gaussians as a PLY. Its coordinates are the
//! objects' own, and the number of the object is a further property.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use glam::DVec3;
use omnilife_engine::{
    gaussians::{
        static_gaussians::{InitialGaussians, POSITIONS},
        tracked::{self, OBJECT_NUMBERS, OBJECT_POSITIONS, TrackedGaussians, TrackedObject},
    },
    model::Part,
    parameters::{ParameterTable, SharedParameters},
    trajectories::rigid_path::RigidPath,
};
use omnilife_schemas::{
    Similarity,
    records::{GraphObject, InvalidGaussians, Objects},
    store::{self, StoreError},
};

use crate::{error::ReconstructError, formats::ply};

/// Name of the objects' record in a run's folder.
pub const OBJECTS_FILE: &str = "objects.json";
/// Name of the objects' Gaussians in a run's folder.
pub const OBJECT_GAUSSIANS_FILE: &str = "gaussians-objects.ply";

/// The objects' own coordinates are those of the file.
const AS_IS: Similarity = Similarity::new([0.0; 3], 1.0);

/// Writes the objects of a part with the corrections of their paths, object after object, atomically.
///
/// # Errors
/// When a file cannot be written.
pub fn write(
    folder: &Path,
    (objects, corrections): (&[TrackedObject], &SharedParameters),
    table: &ParameterTable,
    normalization: &Similarity,
) -> Result<(), StoreError> {
    write_table(folder, table)?;
    let mut corrections = corrections.array.values.as_slice();
    let up = objects
        .first()
        .map_or(DVec3::Z, |object| object.path.up().as_dvec3());
    let objects = objects.iter().map(|object| {
        let (own, rest) = corrections.split_at(object.path.correction_len());
        corrections = rest;
        let unit = 1.0 / normalization.scale;
        let lever = f64::from(object.path.lever());
        GraphObject {
            id: object.id,
            dimensions: object.dimensions.map(|side| f64::from(side) * unit),
            path: object.path.in_world(normalization),
            corrections: own
                .as_chunks::<4>()
                .0
                .iter()
                .map(|&[x, y, z, turn]| {
                    let [x, y, z] = [x, y, z].map(|value| f64::from(value) * unit);
                    [x, y, z, f64::from(turn) / lever]
                })
                .collect(),
        }
    });
    let record = Objects {
        up: up.to_array(),
        objects: objects.collect(),
    };
    store::write_record(&folder.join(OBJECTS_FILE), &record)
}

/// Writes the Gaussians of objects.
#[expect(clippy::indexing_slicing, reason = "object numbers are one wide")]
pub(crate) fn write_table(folder: &Path, table: &ParameterTable) -> Result<(), StoreError> {
    let numbers = table.position(OBJECT_NUMBERS).unwrap_or(POSITIONS);
    ply::write_with(
        &folder.join(OBJECT_GAUSSIANS_FILE),
        table,
        &AS_IS,
        &[OBJECT_NUMBERS.to_owned()],
        |index, row| row.push(table.row(numbers, index)[0]),
    )
}

/// Reads the files of [`write()`]; invalid Gaussians are counted in `invalid`.
///
/// # Errors
/// When a file is missing or malformed, or a Gaussian belongs to a missing object.
pub fn read(
    folder: &Path,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<Part, ReconstructError> {
    let (record, table) = read_parts(folder, invalid)?;
    let up = DVec3::from_array(record.up);
    let mut corrections = Vec::new();
    let mut objects = Vec::new();
    for object in &record.objects {
        let scale = normalization.scale;
        let dimensions = object.dimensions.map(|side| (side * scale) as f32);
        let lever = 0.5 * dimensions[0];
        let path = RigidPath::new(
            &object.path,
            up,
            lever,
            object.corrections.len(),
            normalization,
        );
        for &[x, y, z, turn] in &object.corrections {
            corrections.extend([x, y, z].map(|value| (value * scale) as f32));
            corrections.push((turn * f64::from(path.lever())) as f32);
        }
        objects.push(TrackedObject {
            id: object.id,
            dimensions,
            path,
        });
    }
    let mut tracked = TrackedGaussians::new(objects, false);
    tracked.corrections.array.values = corrections;
    Ok(Part::new(tracked, table))
}

/// Returns the record and the Gaussians of a run's objects.
///
/// # Errors
/// Those of [`read`].
#[expect(
    clippy::indexing_slicing,
    reason = "static Gaussians begin with their positions"
)]
pub(crate) fn read_parts(
    folder: &Path,
    invalid: &mut InvalidGaussians,
) -> Result<(Objects, ParameterTable), ReconstructError> {
    let path = folder.join(OBJECTS_FILE);
    let record: Objects = store::read_record(&path)?;
    let malformed = |reason: String| StoreError::malformed(&path, reason);
    for object in &record.objects {
        if let Some(fault) = object.path.fault() {
            return Err(malformed(format!("the path of object {} {fault}", object.id)).into());
        }
        let sides = object
            .dimensions
            .iter()
            .chain(object.corrections.as_flattened());
        let is_sound = sides.clone().all(|value| value.is_finite())
            && object.dimensions.iter().all(|&side| side > 0.0)
            && !object.corrections.is_empty();
        if !is_sound {
            let reason = format!(
                "object {} has no box or corrections that are possible",
                object.id
            );
            return Err(malformed(reason).into());
        }
    }
    if record.objects.is_empty() {
        // All objects were removed.
        return Ok((record, tracked::table(&InitialGaussians::default(), &[])));
    }
    let gaussians = folder.join(OBJECT_GAUSSIANS_FILE);
    let further = [OBJECT_NUMBERS.to_owned()];
    let (mut table, mut columns) = ply::read_with(&gaussians, &AS_IS, &further, invalid)?;
    let numbers = columns.pop().unwrap_or_default();
    let count = record.objects.len() as f32;
    if let Some(other) = numbers
        .iter()
        .find(|&&number| !(number >= 0.0 && number < count))
    {
        let reason = format!("has Gaussians of object number {other}, and there are {count}");
        return Err(StoreError::malformed(&gaussians, reason).into());
    }
    table.arrays[POSITIONS].name = OBJECT_POSITIONS;
    let array = table.add(OBJECT_NUMBERS, 1, numbers, 0.0);
    table.freeze(array);
    Ok((record, table))
}
