//! The scene record in an export of our format: source of everything that no other format holds.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{CLASSES_FOLDER, DEPTH_FOLDER, DEPTH_PRIOR_FOLDER},
    records::{DepthImage, DepthPrior, PoseValidation, Scene, SceneFrame},
    store,
};

use super::{ForeignFrame, Format, Part, frame_times::FrameTimes, frames};
use crate::error::CurateError;

/// Record of a folder in a format that holds all of a scene.
pub(super) struct OwnRecord {
    folder: PathBuf,
    scene: Scene,
    /// Numbers of frames by their images.
    numbers: BTreeMap<PathBuf, usize>,
}

impl OwnRecord {
    /// Reads the record of a folder; `None` if the format or the folder has none.
    ///
    /// # Errors
    /// When it is malformed.
    pub(super) fn read(format: &Format, folder: &Path) -> Result<Option<Self>, CurateError> {
        let holds_all = (format.export).is_some_and(|writer| writer.holds == Part::ALL);
        if !holds_all {
            return Ok(None);
        }
        let Some(scene) = frames::record(folder)? else {
            return Ok(None);
        };
        let numbers = (scene.frames.iter().enumerate())
            .map(|(number, frame)| (folder.join(&frame.image), number))
            .collect();
        Ok(Some(Self {
            folder: folder.to_owned(),
            scene,
            numbers,
        }))
    }

    fn frame(&self, frame: &ForeignFrame) -> Option<&SceneFrame> {
        let number = self.numbers.get(&frame.image)?;
        self.scene.frames.get(*number)
    }

    pub(super) fn times(&self, frames: &[ForeignFrame]) -> FrameTimes {
        // Readers of the record return no other frames.
        let known = frames.iter().filter_map(|frame| self.frame(frame));
        FrameTimes {
            seconds: known.map(|frame| frame.time_seconds).collect(),
            notes: Vec::new(),
        }
    }

    /// Returns the mask of pixels outside the scene in a frame.
    pub(super) fn ignore_mask(&self, frame: &ForeignFrame) -> Option<PathBuf> {
        let file = self.frame(frame)?.ignore_mask.as_ref()?;
        Some(self.folder.join(file))
    }

    /// Copies masks of classes and distances of a frame, and enters them into its record. `name` is that of its
    /// image in the folder `out`.
    ///
    /// # Errors
    /// When a file cannot be copied.
    pub(super) fn complete(
        &self,
        (frame, name): (&ForeignFrame, &str),
        entry: &mut SceneFrame,
        out: &Path,
    ) -> Result<(), CurateError> {
        let Some(known) = self.frame(frame) else {
            return Ok(());
        };
        entry.capture.clone_from(&known.capture);
        entry.boxes.clone_from(&known.boxes);
        let stem = super::stem(name);
        let copy = |file: &str, to: String| -> Result<String, CurateError> {
            let path = out.join(&to);
            super::create_parent(&path)?;
            store::copy_atomically(&self.folder.join(file), &path)?;
            Ok(to)
        };
        for (class, file) in &known.classes {
            let place = copy(file, format!("{CLASSES_FOLDER}/{class}/{stem}.png"))?;
            entry.classes.insert(class.clone(), place);
        }
        if let Some(depth) = &known.depth {
            let place = format!("{DEPTH_FOLDER}/{stem}.{}", extension(&depth.file));
            entry.depth = Some(DepthImage {
                file: copy(&depth.file, place)?,
                ..depth.clone()
            });
        }
        if let Some(prior) = &known.depth_prior {
            let place = format!("{DEPTH_PRIOR_FOLDER}/{stem}.{}", extension(&prior.file));
            entry.depth_prior = Some(DepthPrior {
                file: copy(&prior.file, place)?,
                ..prior.clone()
            });
        }
        Ok(())
    }

    /// Returns the validation of the scene's poses, with the import's findings (`found`). It does not apply to other
    /// frames than those of the record.
    pub(super) fn validation(&self, found: PoseValidation) -> PoseValidation {
        let known = &self.scene.validation;
        if found.total_frames != known.total_frames {
            return found;
        }
        let news = found.problems.into_iter();
        let news = news.filter(|line| !known.problems.contains(line));
        PoseValidation {
            registered_frames: found.registered_frames,
            total_frames: found.total_frames,
            status: known.status,
            measures: known.measures.clone(),
            problems: known.problems.iter().cloned().chain(news).collect(),
        }
    }
}

/// Returns the id of a scene to be imported: that of its own record, if the folder has one, else the folder's name.
///
/// # Errors
/// For an unknown format and a malformed record.
pub fn scene_id(format: &str, folder: &Path) -> Result<String, CurateError> {
    let own = OwnRecord::read(super::format(format, folder)?, folder)?;
    let name = folder.file_name().unwrap_or_default();
    Ok(own.map_or_else(|| name.to_string_lossy().into_owned(), |own| own.scene.id))
}

/// Returns the extension of a distance file, PNG or array.
pub(super) fn extension(file: &str) -> &str {
    file.rsplit_once('.')
        .map_or("png", |(_, extension)| extension)
}
