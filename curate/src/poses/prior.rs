//! Depth priors of a sequence's frames: from a network, a sensor, another program.
//!
//! They are given to methods, never scored against ([`super::truth`] holds true ones).

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    distances::DistanceImage,
    layout::DEPTH_PRIOR_FOLDER,
    npy,
    progress::Progress,
    records::{DepthPrior, DistanceConvention, DistanceGrid, FrameEntry, SceneFrame},
    stage::StagePlan,
    staging::Staging,
};

use super::{masks, saturated::SaturatedFiles};
use crate::{error::CurateError, frame_order};

/// Files of distances, named like the frames.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenPrior {
    /// Folder of 16-bit grey PNG or `.npy` files; 0 for an unknown distance.
    pub folder: PathBuf,
    /// Length of a step of 1 in the files, in units of the world frame.
    pub unit: f64,
    /// Grid of their pixels.
    pub grid: DistanceGrid,
    /// Line along which their distances are measured.
    pub convention: DistanceConvention,
    /// Estimator.
    pub source: String,
}

/// [`GivenPrior`] with the files of the frames that have one.
pub(super) struct PriorFiles {
    given: GivenPrior,
    files: Vec<Option<PathBuf>>,
}

const EXTENSIONS: &[&str] = &["png", "npy"];

impl GivenPrior {
    /// Finds the files.
    ///
    /// # Errors
    /// When no frame has one, two files belong to one frame, or the unit is not positive.
    pub(super) fn find(&self, frames: &[FrameEntry]) -> Result<PriorFiles, CurateError> {
        if !(self.unit.is_finite() && self.unit > 0.0) {
            let reason = format!("the unit of distances must be positive, got {}", self.unit);
            return Err(CurateError::input(&self.folder, reason));
        }
        let files = masks::find_some(&self.folder, frames, EXTENSIONS)?;
        if files.iter().all(Option::is_none) {
            let reason = format!(
                "has no distances of any of the {} frames (PNG or .npy files named like the frames, \
                 such as {}.png)",
                files.len(),
                frames.first().map_or("000000", |entry| {
                    let stem = Path::new(&entry.file).file_stem();
                    stem.and_then(|stem| stem.to_str()).unwrap_or("000000")
                })
            );
            return Err(CurateError::input(&self.folder, reason));
        }
        Ok(PriorFiles {
            given: self.clone(),
            files,
        })
    }
}

impl PriorFiles {
    /// Returns the files of the frames that have one.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter().flatten()
    }

    /// Adds their dependencies to a plan.
    pub(super) fn add_inputs(&self, plan: StagePlan) -> Result<StagePlan, CurateError> {
        let GivenPrior {
            unit,
            grid,
            convention,
            source,
            ..
        } = &self.given;
        let mut plan = plan
            .with_settings("prior unit", unit)
            .with_settings("prior grid", grid)
            .with_settings("prior convention", convention)
            .with_text("prior source", source);
        for (number, file) in self.files.iter().enumerate() {
            if let Some(file) = file {
                plan = plan
                    .with_settings("prior of frame", &number)
                    .with_file(file)?;
            }
        }
        Ok(plan)
    }

    /// Stages them on the project's grid as f32 arrays, at their own size, and enters them in the frames of a scene.
    ///
    /// # Errors
    /// When a file is not usable, has another aspect ratio than the frames, or cannot be written.
    pub(super) fn stage(
        &self,
        staging: &mut Staging,
        sequence_folder: &Path,
        frames: &mut [SceneFrame],
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let files = self.files.iter().flatten();
        super::truth::refuse_own(files, &sequence_folder.join(DEPTH_PRIOR_FOLDER))?;
        let missing = self.files.iter().filter(|file| file.is_none()).count();
        if missing > 0 {
            let (folder, all) = (self.given.folder.display(), self.files.len());
            progress.note(&format!(
                "{folder}: {missing} of {all} frames have no distances"
            ));
        }
        let mut saturated = SaturatedFiles::new(self.given.unit);
        for ((number, source), frame) in self.files.iter().enumerate().zip(frames) {
            if let Some(source) = source {
                let (prior, largest) = self.stage_one(staging, source, number, size)?;
                frame.depth_prior = Some(prior);
                saturated.add(source, largest.into_iter());
            }
        }
        saturated.report(progress);
        Ok(())
    }

    /// Stages the distances of a frame; also returns true for every pixel with the largest distance of 16 bits.
    fn stage_one(
        &self,
        staging: &mut Staging,
        source: &Path,
        number: usize,
        [width, height]: [usize; 2],
    ) -> Result<(DepthPrior, Vec<bool>), CurateError> {
        let image = DistanceImage::read(source, self.given.unit, true)?;
        // Half a pixel of rounding either way.
        let expected_rows = image.width as f64 * height as f64 / width as f64;
        if (expected_rows - image.height as f64).abs() > 0.5 {
            let reason = format!(
                "is {}x{}, of another shape than the frames of {width}x{height}",
                image.width, image.height
            );
            return Err(CurateError::input(source, reason));
        }
        let largest = (f64::from(u16::MAX) * self.given.unit) as f32;
        let is_array = frame_order::has_extension(source, &["npy"]);
        let marks = image
            .values
            .iter()
            .map(|&value| !is_array && value >= largest);
        let marks = marks.collect();
        let image = image.brought_from(self.given.grid);
        let file = format!("{DEPTH_PRIOR_FOLDER}/{number:06}.npy");
        let shape = [image.height, image.width];
        npy::write_f32(&staging.begin(&file)?, &shape, &image.values)?;
        let prior = DepthPrior {
            file,
            unit: 1.0,
            width: image.width as u32,
            height: image.height as u32,
            convention: self.given.convention,
            source: self.given.source.clone(),
        };
        Ok((prior, marks))
    }
}
