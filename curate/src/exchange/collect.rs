//! What of a scene is exported.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    Pose,
    layout::SCENE_FILE,
    ownership::is_inside,
    padded_frame::PaddedFrame,
    points::PointCloud,
    progress::Progress,
    records::{Scene, Split},
    store,
};

use super::{ExportFrame, ExportScene, file_name, stem};
use crate::error::CurateError;

/// The posed frames of a scene with their files, and the frames that the protocol of its split puts images into.
///
/// # Errors
/// For the split of another scene, a scene without posed frames, and files that cannot be exported.
pub(super) fn collect(
    folder: &Path,
    split: Option<&Path>,
    progress: &dyn Progress,
) -> Result<(ExportScene, Option<PaddedFrame>), CurateError> {
    let path = folder.join(SCENE_FILE);
    let scene: Scene = store::read_record(&path)?;
    let split: Option<(&Path, Split)> = match split {
        Some(file) => Some((file, store::read_record(file)?)),
        None => None,
    };
    if let Some((file, split)) = &split
        && split.scene != scene.id
    {
        return Err(CurateError::input(
            file,
            format!("is the split of {}, not of {}", split.scene, scene.id),
        ));
    }
    let is_input = |index: usize| {
        split
            .as_ref()
            .is_none_or(|(_, split)| split.input_views.contains(&(index as u32)))
    };
    refuse_unusable_names(&path, &scene)?;
    let frames: Vec<ExportFrame> = scene
        .frames
        .iter()
        .enumerate()
        .filter_map(|(index, frame)| {
            Some(ExportFrame {
                name: file_name(&frame.image),
                image: folder.join(&frame.image),
                mask: frame.mask.as_ref().map(|mask| folder.join(mask)),
                ignore_mask: frame.ignore_mask.as_ref().map(|mask| folder.join(mask)),
                pose: frame.pose.filter(Pose::is_valid)?,
                time_seconds: frame.time_seconds,
                is_input: is_input(index),
            })
        })
        .collect();
    if frames.is_empty() {
        return Err(CurateError::input(&path, "has no frame with a pose"));
    }
    if frames.len() < scene.frames.len() {
        progress.note(&format!(
            "{}: {} of {} frames have no pose and are left out",
            scene.id,
            scene.frames.len() - frames.len(),
            scene.frames.len()
        ));
    }
    let points = match &scene.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?,
        None => PointCloud::default(),
    };
    if split.is_none() {
        progress.note(&format!(
            "{}: no split is given: frames for testing are not marked, and all are for training",
            scene.id
        ));
    }
    let padded = match &split {
        Some((file, split)) => (split.protocol.padded_frame(&scene.camera))
            .map_err(|reason| CurateError::input(file, reason))?,
        None => None,
    };
    let scene = ExportScene {
        camera: scene.camera,
        panorama: None,
        frames,
        points,
        has_split: split.is_some(),
        is_rig: false,
    };
    Ok((scene, padded))
}

/// Refuses files outside of the scene's folder, which are nobody's to hand on, and frames that would
/// become one file: all images, and all masks, lie in one folder in an export.
fn refuse_unusable_names(path: &Path, scene: &Scene) -> Result<(), CurateError> {
    let mut stems = BTreeMap::new();
    for (number, frame) in scene.frames.iter().enumerate() {
        let masks = frame.mask.iter().chain(&frame.ignore_mask);
        for file in [&frame.image].into_iter().chain(masks) {
            if !is_inside(file) {
                let reason = format!("{file:?} of frame {number} is no file in its folder");
                return Err(CurateError::input(path, reason));
            }
        }
        let name = file_name(&frame.image);
        if let Some(other) = stems.insert(stem(&name).to_owned(), number) {
            let reason = format!("frames {other} and {number} have one file name, {name}");
            return Err(CurateError::input(path, reason));
        }
    }
    match scene.points.iter().find(|file| !is_inside(file)) {
        Some(file) => {
            let reason = format!("{file:?} is no file in its folder");
            Err(CurateError::input(path, reason))
        }
        None => Ok(()),
    }
}
