//! Files of a model in a run's folder: one format for each parameterization. [`exchange`] has those of other programs,
//! [`in_time`] the open format of Gaussians that move.
//!
//! A new one needs a file with its writer and reader, and a line in `FORMATS`.

pub mod axes;
mod codebook;
mod compressed_ply;
pub mod deformation;
pub mod exchange;
mod glb;
pub mod in_time;
pub mod moving_ply;
pub mod objects;
pub mod ply;
pub mod ranges;
mod refined_poses;
mod sog;
pub mod splat;
mod spz;
pub mod validity;

use std::{collections::BTreeSet, path::Path};

use omnilife_engine::{
    gaussians::{deformable::Deformable, static_gaussians::StaticGaussians},
    model::{Model, Part},
    parameters::ParameterTable,
    step::settings::TrainSettings,
};
use omnilife_schemas::{
    Similarity,
    records::InvalidGaussians,
    store::{self, StoreError},
};

pub use objects::{OBJECT_GAUSSIANS_FILE, OBJECTS_FILE};
pub use refined_poses::REFINED_POSES_FILE;

use crate::{error::ReconstructError, scene::TrainingScene};

/// Name of the static or canonical Gaussians in a run's folder.
pub const GAUSSIANS_FILE: &str = "gaussians.ply";
/// Name of the Gaussians with times of their own; static methods do without.
pub const MOVING_GAUSSIANS_FILE: &str = "gaussians-moving.ply";
/// Name of the network that deforms Gaussians; most methods do without.
pub const DEFORMATION_FILE: &str = "deformation.safetensors";

/// Files of Gaussians without objects, and of the poses refined with them.
pub const GAUSSIAN_FILES: &[&str] = &[
    GAUSSIANS_FILE,
    MOVING_GAUSSIANS_FILE,
    DEFORMATION_FILE,
    REFINED_POSES_FILE,
];

/// Returns notes on invalid values of a model's file or folder, and on parts of the same model beside a file, which are
/// not drawn with it.
pub fn notes_on(path: &Path, invalid: &InvalidGaussians) -> Vec<String> {
    let mut notes = validity::notes(path, invalid);
    let parts = FORMATS.iter().flat_map(|format| format.files);
    let parts: BTreeSet<&str> = parts.copied().collect();
    let own = path.file_name().and_then(|name| name.to_str());
    if let Some(own) = own.filter(|own| path.is_file() && parts.contains(own)) {
        let mut others: Vec<String> = parts.into_iter().map(str::to_owned).collect();
        others.retain(|name| name != own && path.with_file_name(name).is_file());
        if !others.is_empty() {
            notes.push(format!(
                "{}: is taken alone, without {} beside it; the run's folder has the whole model",
                path.display(),
                others.join(" and ")
            ));
        }
    }
    notes
}

/// Files of the parts of one parameterization.
struct Format {
    /// [`omnilife_engine::gaussians::parameterization::Parameterization::id`].
    parameterization: &'static str,
    /// Its files.
    files: &'static [&'static str],
    /// Writes a part into a folder.
    write: fn(&Path, &Part, &TrainSettings, &Similarity) -> Result<(), StoreError>,
    /// Reads a part; `None` if the settings do not have it.
    read: fn(&Path, &TrainSettings, &Similarity, &mut InvalidGaussians) -> ReadPart,
}

/// A part of a model, if its settings have it.
type ReadPart = Result<Option<Part>, ReconstructError>;

/// All formats, in the order of the parts of a model.
const FORMATS: &[Format] = &[
    Format {
        parameterization: "static",
        files: &[GAUSSIANS_FILE],
        write: |folder, part, _, normalization| {
            ply::write(&folder.join(GAUSSIANS_FILE), &part.table, normalization)
        },
        read: |folder, settings, normalization, invalid| match settings.deformation {
            Some(_) => Ok(None),
            None => read_static(&folder.join(GAUSSIANS_FILE), normalization, invalid).map(Some),
        },
    },
    // Static Gaussians that are kept near their first positions; that matters in training only.
    Format {
        parameterization: "anchored",
        files: &[GAUSSIANS_FILE],
        write: |folder, part, _, normalization| {
            ply::write(&folder.join(GAUSSIANS_FILE), &part.table, normalization)
        },
        read: |_, _, _, _| Ok(None),
    },
    Format {
        parameterization: "deformable",
        files: &[GAUSSIANS_FILE, DEFORMATION_FILE],
        write: |folder, part, settings, normalization| {
            ply::write(&folder.join(GAUSSIANS_FILE), &part.table, normalization)?;
            match (part.parameterization.shared(), &settings.deformation) {
                (Some(weights), Some(settings)) => {
                    deformation::write(&folder.join(DEFORMATION_FILE), &settings.model, weights)
                }
                _ => Ok(()),
            }
        },
        read: |folder, settings, normalization, invalid| {
            let Some(settings) = settings.deformation else {
                return Ok(None);
            };
            let table = ply::read(&folder.join(GAUSSIANS_FILE), normalization, invalid)?;
            let weights = deformation::read(&folder.join(DEFORMATION_FILE), &settings.model)?;
            let mut deformable = Deformable::new(settings, Vec::new());
            // Trained weights always take part in images.
            deformable.weights = weights;
            deformable.weights.steps = deformable.weights.steps.max(1);
            Ok(Some(Part::new(deformable, table)))
        },
    },
    Format {
        parameterization: "temporal",
        files: &[MOVING_GAUSSIANS_FILE],
        write: |folder, part, _, normalization| match part.parameterization.temporal() {
            Some(temporal) => moving_ply::write(
                &folder.join(MOVING_GAUSSIANS_FILE),
                &part.table,
                &temporal.time,
                normalization,
                &temporal.clock,
            ),
            None => Ok(()),
        },
        read: |folder, settings, normalization, invalid| {
            let Some(dynamics) = &settings.dynamics else {
                return Ok(None);
            };
            let path = folder.join(MOVING_GAUSSIANS_FILE);
            let (time, clock) = (&dynamics.time, &dynamics.clock);
            let table = moving_ply::read(&path, time, normalization, clock, invalid)?;
            Ok(Some(Part::new(dynamics.parameterization(), table)))
        },
    },
    Format {
        parameterization: "tracked",
        files: &[OBJECT_GAUSSIANS_FILE, OBJECTS_FILE],
        write: |folder, part, _, normalization| {
            let parameterization = &part.parameterization;
            match (parameterization.tracked(), parameterization.shared()) {
                (Some(tracked), Some(corrections)) => {
                    let paths = (tracked.objects(), corrections);
                    objects::write(folder, paths, &part.table, normalization)
                }
                _ => Ok(()),
            }
        },
        read: |folder, settings, normalization, invalid| {
            if settings.objects {
                objects::read(folder, normalization, invalid).map(Some)
            } else {
                Ok(None)
            }
        },
    },
];

/// Reads static Gaussians of a PLY, of this or of another program; invalid values are counted in `invalid`.
///
/// # Errors
/// When the file cannot be read, or is empty.
pub fn read_static(
    path: &Path,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<Part, ReconstructError> {
    let table = ply::read(path, normalization, invalid)?;
    let parameterization = StaticGaussians;
    Ok(Part::new(parameterization, table))
}

/// Writes the files of a model with its refined poses, and removes leftover files of an earlier model. Returns
/// their names.
///
/// # Errors
/// When a file cannot be written, or a part has no format.
pub fn write_model(
    folder: &Path,
    model: &Model,
    settings: &TrainSettings,
    scene: &TrainingScene,
) -> Result<Vec<String>, ReconstructError> {
    let mut written = Vec::new();
    let joined = settings.shards.is_some().then(|| joined(&model.parts));
    for part in joined
        .as_ref()
        .map_or(&model.parts[..], std::slice::from_ref)
    {
        let id = part.parameterization.id();
        let format = FORMATS
            .iter()
            .find(|format| format.parameterization == id)
            .ok_or_else(|| ReconstructError::Request {
                reason: format!(
                    "the Gaussians must have a file format to be written, and {id} has none"
                ),
            })?;
        (format.write)(folder, part, settings, &scene.normalization)?;
        written.extend(format.files.iter().map(|&file| file.to_owned()));
    }
    if model.poses.is_some() {
        refined_poses::write(folder, scene, model)?;
        written.push(REFINED_POSES_FILE.to_owned());
    }
    let known = FORMATS.iter().flat_map(|format| format.files);
    for file in known.chain(&[REFINED_POSES_FILE]) {
        if written.iter().all(|written| written != file) {
            store::remove(&folder.join(file))?;
        }
    }
    Ok(written)
}

/// Returns shards as one part.
fn joined(parts: &[Part]) -> Part {
    let tables = parts.iter().map(|part| &part.table);
    Part::new(StaticGaussians, ParameterTable::joined(tables))
}

/// Reads the model in a run's folder, trained under `settings`; invalid values are counted in `invalid`.
///
/// # Errors
/// When a file is missing or malformed.
pub fn read_model(
    folder: &Path,
    settings: &TrainSettings,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<Model, ReconstructError> {
    let parts = FORMATS
        .iter()
        .map(|format| (format.read)(folder, settings, normalization, invalid));
    let parts = parts.collect::<Result<Vec<_>, _>>()?;
    Ok(Model::new(parts.into_iter().flatten().collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_a_model_taken_alone_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str| std::fs::write(at(name), "").expect("a file");
        let notes = |path: &Path| notes_on(path, &InvalidGaussians::default());
        write(GAUSSIANS_FILE);
        assert!(notes(&at(GAUSSIANS_FILE)).is_empty());
        write(MOVING_GAUSSIANS_FILE);
        let told = notes(&at(GAUSSIANS_FILE));
        assert!(
            told.len() == 1 && told[0].contains(MOVING_GAUSSIANS_FILE),
            "{told:?}"
        );
        // The folder has all of it, and files of other names are no parts.
        write("other.ply");
        assert!(notes(folder.path()).is_empty() && notes(&at("other.ply")).is_empty());
    }

    #[test]
    fn parameterizations_have_one_format_each() {
        for (number, format) in FORMATS.iter().enumerate() {
            let is_other = |other: &Format| other.parameterization != format.parameterization;
            assert!(FORMATS[..number].iter().all(is_other));
            assert!(!format.files.is_empty(), "{}", format.parameterization);
        }
    }
}
