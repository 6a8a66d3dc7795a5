//! Inputs that methods require beside a scene and its split, made where the scene lacks them.
//!
//! `run`, `reconstruct prepare` and the units of benchmarks and ablations call this module, so that a method has its
//! requirements wherever it is run.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use omnilife_reconstruct::methods::{Method, requirement::Requirement};
use omnilife_schemas::{
    camera::Camera,
    layout::DENSE_FOLDER,
    progress::Progress,
    records::{PoseSource, Scene, Tracks},
    store,
};
use omnilife_tracks::{
    TrackOptions, TrackRequest,
    dense::{self, DenseRequest, make_dense},
    make_tracks,
};

/// Makes everything that `methods` require of a scene and a split, in the order of their rows; tracks by `tracking`.
/// Existing inputs that are up to date are not made again.
///
/// # Errors
/// When the scene cannot be read, or a requirement cannot be made.
pub(crate) fn prepare(
    methods: &[&Method],
    scene: &Path,
    split: &Path,
    tracking: &TrackOptions,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let requirements: BTreeSet<Requirement> = (methods.iter())
        .flat_map(|method| method.requires.iter().copied())
        .collect();
    for requirement in requirements {
        meet(requirement, scene, split, tracking, progress)?;
    }
    Ok(())
}

/// Makes one requirement.
fn meet(
    requirement: Requirement,
    scene: &Path,
    split: &Path,
    tracking: &TrackOptions,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    match requirement {
        // A scene has parallax or planar ground, or not; the method refuses one without them.
        Requirement::Parallax => Ok(()),
        Requirement::DensePoints => dense_points(scene, split, false, progress),
        Requirement::Tracks => {
            if has_labels(scene, split, progress)? {
                return Ok(());
            }
            let request = TrackRequest {
                scene_folder: folder_of(scene),
                split: Some(split.to_owned()),
                options: tracking.clone(),
                out: folder_of(split),
            };
            make_tracks(&request, progress)?;
            Ok(())
        }
    }
}

/// Returns true, with a note, where the tracks beside a split are labels of a dataset, which are taken as they are.
fn has_labels(scene: &Path, split: &Path, progress: &dyn Progress) -> anyhow::Result<bool> {
    let scene: Scene = store::read_record(scene)?;
    // Tracks that cannot be read are left to the tracker, which replaces its own and refuses others.
    let tracks = Tracks::beside_split(&scene.id, &folder_of(split));
    let labelled = tracks.ok().flatten().filter(Tracks::are_labels);
    if let Some(tracks) = &labelled {
        progress.note(&format!(
            "{}: {} tracks are labels of a dataset, taken as they are",
            scene.id,
            tracks.tracks.len()
        ));
    }
    Ok(labelled.is_some())
}

/// Measures dense points of a perspective scene by stereo where it has few, or in any case with `always`. A hovering
/// camera shows no distances, and panoramas come with their own points.
pub(crate) fn dense_points(
    scene_file: &Path,
    split: &Path,
    always: bool,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let scene: Scene = store::read_record(scene_file)?;
    let is_perspective = matches!(scene.camera, Camera::Pinhole(_));
    if !is_perspective || matches!(scene.pose_source, PoseSource::Registered { .. }) {
        return Ok(());
    }
    let few = dense::few_points(&scene, &folder_of(scene_file))?;
    match &few {
        Some(few) => progress.note(&format!("{}: dense stereo, because {few}", scene.id)),
        None if always => {}
        None => return Ok(()),
    }
    let request = DenseRequest {
        scene_folder: folder_of(scene_file),
        split: Some(split.to_owned()),
        width: dense::SEARCH_WIDTH,
        out: split.with_file_name(DENSE_FOLDER),
    };
    make_dense(&request, progress)?;
    Ok(())
}

/// Returns the folder of a file.
fn folder_of(file: &Path) -> PathBuf {
    match file.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}
