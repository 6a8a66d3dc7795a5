//! Scenes for exports: frames with a pose, their files, and the split.

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

use super::{ExportFrame, ExportRequest, ExportScene, SceneSource, file_name, stem};
use crate::error::CurateError;

/// Returns the scene of a request without excluded frames, with the frames whose images the protocol of its split uses.
///
/// # Errors
/// When a file cannot be read or leads out of the scene's folder, two frames have one name, or no frame has a pose.
/// Also when the split belongs to another scene.
pub(super) fn collect(
    request: &ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<(ExportScene, Option<PaddedFrame>), CurateError> {
    let folder = request.scene_folder;
    let path = folder.join(SCENE_FILE);
    let mut scene: Scene = store::read_record(&path)?;
    let split = request
        .split
        .map(|file| split_of(file, &scene))
        .transpose()?;
    let is_input = |index: usize| {
        split
            .as_ref()
            .is_none_or(|split| split.input_views.contains(&(index as u32)))
    };
    refuse_unusable_names(&path, &scene)?;
    let mut frames: Vec<ExportFrame> = scene
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
    if request.given_only {
        frames.retain(|frame| frame.is_input);
        let all = std::mem::take(&mut scene.frames).into_iter().enumerate();
        scene.frames = all
            .filter(|(index, _)| is_input(*index))
            .map(|(_, frame)| frame)
            .collect();
        if let Some(published) = scene.published_split.take_if(|_| split.is_some()) {
            progress.note(&format!(
                "{}: the split of {} is one of all frames and left out",
                scene.id, published.source
            ));
        }
    }
    let points = match &scene.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?,
        None => PointCloud::default(),
    };
    if split.is_none() {
        progress.note(&format!(
            "{}: no split is given (--split): all frames are for training",
            scene.id
        ));
    }
    let padded = match (request.split, &split) {
        (Some(file), Some(split)) => (split.protocol.padded_frame(&scene.camera))
            .map_err(|reason| CurateError::input(file, reason))?,
        _ => None,
    };
    let exported = ExportScene {
        camera: scene.camera,
        panorama: None,
        frames,
        points,
        has_split: split.is_some(),
        is_rig: false,
        scale: scene.scale,
        source: Some(SceneSource {
            folder: folder.to_owned(),
            record: scene,
        }),
    };
    Ok((exported, padded))
}

/// Reads a split of a scene.
///
/// # Errors
/// When it cannot be read or is that of another scene.
fn split_of(file: &Path, scene: &Scene) -> Result<Split, CurateError> {
    let split: Split = store::read_record(file)?;
    if split.scene != scene.id {
        let reason = format!("is the split of {}, not of {}", split.scene, scene.id);
        return Err(CurateError::input(file, reason));
    }
    Ok(split)
}

/// Refuses files outside of the scene's folder, which must not be distributed, and frames that would become one file:
/// all images, and all masks, lie in one folder in an export.
fn refuse_unusable_names(path: &Path, scene: &Scene) -> Result<(), CurateError> {
    let mut stems = BTreeMap::new();
    for (number, frame) in scene.frames.iter().enumerate() {
        if let Some(file) = frame.files().find(|file| !is_inside(file)) {
            let reason = format!("frame {number} must name a file in its folder, got {file:?}");
            return Err(CurateError::input(path, reason));
        }
        let name = file_name(&frame.image);
        if let Some(other) = stems.insert(stem(&name).to_owned(), number) {
            let reason = format!("frames {other} and {number} have one file name, {name}");
            return Err(CurateError::input(path, reason));
        }
    }
    match scene.points.iter().find(|file| !is_inside(file)) {
        Some(file) => {
            let reason = format!("must name a file in its folder, got {file:?}");
            Err(CurateError::input(path, reason))
        }
        None => Ok(()),
    }
}
