//! Pixels outside the scene in the frames of a sequence: the operator, a tripod, directions that the video does not
//! store.

use std::{
    path::{Path, PathBuf},
    str::FromStr,
};

use omnilife_schemas::{
    layout::IGNORE_MASKS_FOLDER, mask_survey::has_shape, records::SceneFrame, rgb::Mask,
    stage::StagePlan, staging::Staging,
};

use super::{frame_list::FrameList, lens::Straightening, masks, truth};
use crate::error::CurateError;

/// Region outside the scene.
#[derive(Debug, Clone, PartialEq)]
pub enum IgnoredRegion {
    /// White in an image for all frames, or in a folder with one image per frame.
    Masks(PathBuf),
    /// In panoramas, within an angle of the direction straight down from the camera: a tripod, a logo.
    Nadir {
        /// The angle, degrees, above 0 and below 180.
        degrees: f64,
    },
}

impl FromStr for IgnoredRegion {
    type Err = String;

    /// Parses `nadir:DEGREES`, or the path of masks.
    fn from_str(text: &str) -> Result<Self, String> {
        let Some(angle) = text.strip_prefix("nadir:") else {
            return Ok(Self::Masks(PathBuf::from(text)));
        };
        let degrees = angle.parse().ok();
        let degrees = degrees.filter(|degrees| *degrees > 0.0 && *degrees < 180.0);
        degrees
            .map(|degrees| Self::Nadir { degrees })
            .ok_or_else(|| format!("the angle must be between 0 and 180 degrees, got {angle}"))
    }
}

/// Masks of a sequence's frames, white for pixels outside the scene.
#[derive(Debug, Clone)]
pub(super) struct IgnoredPixels {
    /// Mask of all frames, in addition to those of each: directions that the video does not store, and the nadir.
    of_all: Option<Mask>,
    given: GivenMasks,
    /// Columns and rows of the frames.
    size: [usize; 2],
}

#[derive(Debug, Clone)]
enum GivenMasks {
    None,
    /// One image for all frames: objects fixed to the camera.
    OfCamera(PathBuf),
    /// One image per frame.
    OfFrames(Vec<PathBuf>),
}

impl IgnoredPixels {
    /// Finds the given files, and the directions that the layout of the frames' video does not store.
    ///
    /// # Errors
    /// When a folder cannot be read or lacks the mask of some frame, or a nadir is given for perspective frames.
    pub(super) fn find(
        given: Option<&IgnoredRegion>,
        frames: &FrameList,
    ) -> Result<Self, CurateError> {
        let size = frames.size.map(|side| side as usize);
        let mut found = Self {
            of_all: frames.unrecorded.clone(),
            given: GivenMasks::None,
            size,
        };
        match given {
            None => {}
            Some(IgnoredRegion::Nadir { degrees }) => {
                if frames.is_pinhole {
                    let reason = format!(
                        "nadir:{degrees} applies to panoramas only; its frames are perspective"
                    );
                    return Err(CurateError::input(Path::new(&frames.id), reason));
                }
                let below = nadir(size, *degrees);
                if below.data.iter().all(|&value| value != 0) {
                    let reason = format!("nadir:{degrees} leaves nothing of its frames");
                    return Err(CurateError::input(Path::new(&frames.id), reason));
                }
                found.of_all = Some(match found.of_all {
                    Some(unrecorded) => below.united(&unrecorded),
                    None => below,
                });
            }
            Some(IgnoredRegion::Masks(folder)) if folder.is_dir() => {
                found.given = GivenMasks::OfFrames(masks::find(folder, &frames.entries)?);
            }
            Some(IgnoredRegion::Masks(file)) => {
                found.given = GivenMasks::OfCamera(file.to_owned());
            }
        }
        Ok(found)
    }

    /// Returns true if every pixel is part of the scene.
    pub(super) fn is_empty(&self) -> bool {
        self.of_all.is_none() && self.given_files().is_empty()
    }

    /// Returns the given files, one of all frames or one of each.
    pub(super) fn given_files(&self) -> &[PathBuf] {
        match &self.given {
            GivenMasks::None => &[],
            GivenMasks::OfCamera(file) => std::slice::from_ref(file),
            GivenMasks::OfFrames(files) => files.as_slice(),
        }
    }

    /// Returns the given files, one of each frame.
    pub(super) fn files_of_frames(&self) -> &[PathBuf] {
        match &self.given {
            GivenMasks::OfFrames(files) => files.as_slice(),
            GivenMasks::None | GivenMasks::OfCamera(_) => &[],
        }
    }

    /// Adds their dependencies to a plan.
    pub(super) fn add_inputs(&self, plan: StagePlan) -> Result<StagePlan, CurateError> {
        let files = self.given_files();
        let rows_of_all = self.of_all.as_ref().map(|mask| {
            let rows = mask.data.chunks_exact(mask.width);
            rows.map(|row| row.iter().filter(|&&value| value != 0).count())
                .collect::<Vec<_>>()
        });
        if files.is_empty() && rows_of_all.is_none() {
            return Ok(plan);
        }
        let plan = plan.with_settings("ignored", &(files.len(), rows_of_all));
        (files.iter()).try_fold(plan, |plan, file| Ok(plan.with_file(file)?))
    }

    /// Returns the mask of a frame at the size of the frames; `None` if all of it is part of the scene.
    ///
    /// # Errors
    /// When a mask cannot be read, has another aspect ratio than the frame or leaves nothing of it.
    pub(super) fn of_frame(&self, number: usize) -> Result<Option<Mask>, CurateError> {
        let file = match &self.given {
            GivenMasks::None => None,
            GivenMasks::OfCamera(file) => Some(file),
            GivenMasks::OfFrames(files) => Some(&files[number]),
        };
        let given = file.map(|file| self.read(file)).transpose()?;
        let mask = match (given, &self.of_all) {
            (Some(given), Some(of_all)) => given.united(of_all),
            (Some(mask), None) => mask,
            (None, of_all) => return Ok(of_all.clone()),
        };
        let marked = mask.data.iter().filter(|&&value| value != 0).count();
        match file {
            Some(file) if marked == mask.data.len() => {
                Err(CurateError::input(file, "leaves nothing of its frame"))
            }
            _ => Ok((marked > 0).then_some(mask)),
        }
    }

    /// Reads a mask at the size of the frames: a pixel is marked if any inside it is.
    fn read(&self, file: &Path) -> Result<Mask, CurateError> {
        let [width, height] = self.size;
        let mask = Mask::read(file)?;
        if !has_shape([mask.width, mask.height], [width, height]) {
            let reason = format!(
                "is {}x{} pixels, which is not the shape of its frame, {width}x{height}",
                mask.width, mask.height
            );
            return Err(CurateError::input(file, reason));
        }
        Ok(mask.resized_to_any(width, height))
    }

    /// Stages the masks and enters them in the frames of a scene. A lens that is removed from the frames is removed
    /// from the masks as well.
    ///
    /// # Errors
    /// When a mask cannot be read or written, or lies at the place of a staged one.
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

/// Marks the rows of a panorama that lie at least partly within an angle of straight down.
fn nadir([width, height]: [usize; 2], degrees: f64) -> Mask {
    // The lower border of row j is 180 (j + 1) / height degrees from straight up.
    let is_marked = |row: usize| 180.0 * (row + 1) as f64 / height as f64 > 180.0 - degrees;
    Mask {
        width,
        height,
        data: (0..width * height)
            .map(|pixel| 255 * u8::from(is_marked(pixel / width)))
            .collect(),
    }
}
