//! What is no part of the scene in the frames of a sequence: who holds the camera, a tripod, directions that
//! the video does not store.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::IGNORE_MASKS_FOLDER,
    records::{SceneFrame, Sequence},
    rgb::Mask,
    stage::StagePlan,
};

use super::{lens::Straightening, masks, truth};
use crate::{error::CurateError, sphere_layouts, staging::Staging};

/// Masks of a sequence's frames, white where something is no part of the scene.
#[derive(Debug, Clone)]
pub(super) struct IgnoredPixels {
    /// Directions that the video does not store, at the size of the frames.
    unrecorded: Option<Mask>,
    given: GivenMasks,
    /// Columns and rows of the frames.
    size: [usize; 2],
}

#[derive(Debug, Clone)]
enum GivenMasks {
    None,
    /// One image for all frames: what is fixed to the camera.
    OfCamera(PathBuf),
    /// One image per frame.
    OfFrames(Vec<PathBuf>),
}

impl IgnoredPixels {
    /// Finds the masks that are given, an image or a folder with one per frame, and what the layout of the
    /// sequence's video leaves open.
    ///
    /// # Errors
    /// When a folder cannot be read or lacks the mask of some frame.
    pub(super) fn find(given: Option<&Path>, sequence: &Sequence) -> Result<Self, CurateError> {
        let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
        let layout = sequence.frames.converted_from;
        let stored = sequence.probe.upright_size();
        Ok(Self {
            unrecorded: layout.and_then(|layout| sphere_layouts::unrecorded(layout, stored, size)),
            given: match given {
                None => GivenMasks::None,
                Some(folder) if folder.is_dir() => {
                    GivenMasks::OfFrames(masks::find(folder, sequence)?)
                }
                Some(file) => GivenMasks::OfCamera(file.to_owned()),
            },
            size,
        })
    }

    /// Adds what they depend on to a plan.
    pub(super) fn add_inputs(&self, plan: StagePlan) -> Result<StagePlan, CurateError> {
        let files = match &self.given {
            GivenMasks::None => &[],
            GivenMasks::OfCamera(file) => std::slice::from_ref(file),
            GivenMasks::OfFrames(files) => files.as_slice(),
        };
        if files.is_empty() && self.unrecorded.is_none() {
            return Ok(plan);
        }
        let plan = plan.with_settings("ignored", &(files.len(), self.unrecorded.is_some()));
        (files.iter()).try_fold(plan, |plan, file| Ok(plan.with_file(file)?))
    }

    /// The mask of a frame at the size of the frames; `None` where all of it is of the scene.
    ///
    /// # Errors
    /// When a mask cannot be read, or leaves nothing of the frame.
    pub(super) fn of_frame(&self, number: usize) -> Result<Option<Mask>, CurateError> {
        let file = match &self.given {
            GivenMasks::None => return Ok(self.unrecorded.clone()),
            GivenMasks::OfCamera(file) => file,
            GivenMasks::OfFrames(files) => &files[number],
        };
        let [width, height] = self.size;
        let mut mask = Mask::read(file)?.resized_to_any(width, height);
        if let Some(unrecorded) = &self.unrecorded {
            mask = mask.united(unrecorded);
        }
        if mask.data.iter().all(|&value| value != 0) {
            return Err(CurateError::input(file, "leaves nothing of its frame"));
        }
        Ok(Some(mask))
    }

    /// Stages the masks and enters them in the frames of a scene. With a lens that is taken out of the frames it
    /// is taken out of the masks.
    ///
    /// # Errors
    /// When a mask cannot be read or written, or lies where the staged ones go.
    pub(super) fn stage(
        &self,
        staging: &mut Staging,
        sequence_folder: &Path,
        frames: &mut [SceneFrame],
        straightening: Option<&Straightening>,
    ) -> Result<(), CurateError> {
        let mut write = |number: usize, name: &str| -> Result<Option<String>, CurateError> {
            let Some(mask) = self.of_frame(number)? else {
                return Ok(None);
            };
            let mask = straightening.map_or_else(|| mask.clone(), |lens| lens.mask(&mask));
            let file = format!("{IGNORE_MASKS_FOLDER}/{name}.png");
            mask.write_png(&staging.begin(&file)?)?;
            Ok(Some(file))
        };
        let own_folder = sequence_folder.join(IGNORE_MASKS_FOLDER);
        if let GivenMasks::OfFrames(files) = &self.given {
            truth::refuse_own(files.iter(), &own_folder)?;
            for (number, frame) in frames.iter_mut().enumerate() {
                frame.ignore_mask = write(number, &format!("{number:06}"))?;
            }
            return Ok(());
        }
        if let GivenMasks::OfCamera(file) = &self.given {
            truth::refuse_own(std::iter::once(file), &own_folder)?;
        }
        let of_all = write(0, "all")?;
        for frame in frames {
            frame.ignore_mask.clone_from(&of_all);
        }
        Ok(())
    }
}
