//! Masks of moving content, entered into a scene that is posed already.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{SCENE_FILE, SEQUENCE_FILE},
    lock::FolderLock,
    ownership::OwnFile,
    progress::Progress,
    records::{Scene, Sequence},
    rgb::Mask,
    stage::StagePlan,
    store,
};

use super::{STAGE, masks};
use crate::{error::CurateError, staging::Staging};

/// Outcome of entering masks into a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MasksEntry {
    /// The scene has them now.
    Entered,
    /// The scene is unchanged, with the reason.
    Left(String),
}

/// Enters one mask per frame into the scene of a sequence; poses, points and frames stay unchanged. A scene that has
/// masks already keeps them.
///
/// # Errors
/// When the sequence, its scene or a mask cannot be read, a file that posing has not made would be replaced, or one
/// cannot be written.
pub fn enter_masks(
    folder: &Path,
    files: &[PathBuf],
    progress: &dyn Progress,
) -> Result<MasksEntry, CurateError> {
    let scene_path = folder.join(SCENE_FILE);
    let left = |reason: &str| Ok(MasksEntry::Left(reason.to_owned()));
    if !scene_path.is_file() {
        return left("the sequence has no poses yet");
    }
    let sequence: Sequence = store::read_record(&folder.join(SEQUENCE_FILE))?;
    let _lock = FolderLock::take(folder, progress)?;
    let mut scene: Scene = store::read_record(&scene_path)?;
    let plan = StagePlan::new(folder, STAGE);
    if scene.frames.iter().any(|frame| frame.mask.is_some()) {
        return match has_these(folder, &scene, files)? {
            true => Ok(MasksEntry::Entered),
            false => left("its scene has other masks already"),
        };
    }
    let entries = &sequence.frames.entries;
    let is_of_frames = scene.frames.len() == entries.len()
        && (scene.frames.iter().zip(entries)).all(|(frame, entry)| frame.image == entry.file);
    if !is_of_frames {
        return left(
            "the frames of its scene are not those of the sequence: a lens was taken out of them",
        );
    }
    if files.len() != entries.len() {
        let (masks, frames) = (files.len(), entries.len());
        let reason = format!("{masks} masks were given for {frames} frames");
        return Err(CurateError::input(&scene_path, reason));
    }
    if !plan.own_files().files().any(|own| own.file == SCENE_FILE) {
        return left("its scene was not made by `curate poses`");
    }
    let sources: Vec<Option<PathBuf>> = files.iter().cloned().map(Some).collect();
    let mut staging = Staging::new(folder, "entered-masks")?;
    let size = scene.camera.size().into();
    let placed = masks::stage(&mut staging, folder, &sources, size, None)?;
    let mut outputs = plan.publish(&staging.folder, &staging.files)?;
    for (frame, mask) in scene.frames.iter_mut().zip(placed) {
        frame.mask = mask;
    }
    outputs.push(OwnFile {
        file: SCENE_FILE.to_owned(),
        sha256: Some(store::write_record_hashed(&scene_path, &scene)?),
    });
    plan.amend(outputs, |_| false)?;
    Ok(MasksEntry::Entered)
}

/// Returns true if the masks of a scene equal those of `files`, frame by frame.
fn has_these(folder: &Path, scene: &Scene, files: &[PathBuf]) -> Result<bool, CurateError> {
    if scene.frames.len() != files.len() {
        return Ok(false);
    }
    for (frame, file) in scene.frames.iter().zip(files) {
        let Some(own) = &frame.mask else {
            return Ok(false);
        };
        let own = Mask::read(&folder.join(own))?;
        let (width, height) = (own.width, own.height);
        if Mask::read(file)?.resized_to_nearest(width, height) != own {
            return Ok(false);
        }
    }
    Ok(true)
}
