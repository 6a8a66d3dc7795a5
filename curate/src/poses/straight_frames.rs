//! Frames without the distortion of their lens, as files of the scene.

use std::path::Path;

use omnilife_schemas::{
    RgbImage, camera::Camera, layout::STRAIGHT_FRAMES_FOLDER, progress::Progress, records::Sequence,
};
use rayon::prelude::*;

use super::lens::{Lens, Straightening};
use crate::{error::CurateError, staging::Staging};

/// How frames with a lens become those of a camera; `None` where there is nothing to take out.
pub(super) fn prepare(lens: Option<Lens>, camera: Camera) -> Option<Straightening> {
    match camera {
        Camera::Pinhole(straight) => Some(lens?.straightening(&straight)),
        Camera::Erp(_) => None,
    }
}

/// Stages the frames of a sequence; returns their files, relative to its folder.
///
/// # Errors
/// When a frame cannot be read, has not the size of the others, or cannot be written.
pub(super) fn stage(
    staging: &mut Staging,
    folder: &Path,
    sequence: &Sequence,
    straightening: &Straightening,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    let count = sequence.frames.entries.len();
    let files: Vec<String> = (0..count)
        .map(|number| format!("{STRAIGHT_FRAMES_FOLDER}/{number:06}.png"))
        .collect();
    let places = files
        .iter()
        .map(|file| staging.begin(file))
        .collect::<Result<Vec<_>, _>>()?;
    let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
    progress.begin("frames without their lens", Some(count as u64));
    let outcome = sequence
        .frames
        .entries
        .par_iter()
        .zip(&places)
        .try_for_each(|(entry, place)| {
            let source = folder.join(&entry.file);
            let frame = RgbImage::read(&source)?;
            if [frame.width, frame.height] != size {
                let reason = format!(
                    "is {}x{} pixels, the others are not",
                    frame.width, frame.height
                );
                return Err(CurateError::input(&source, reason));
            }
            straightening.image(&frame).write_png(place)?;
            progress.advance(1);
            Ok(())
        });
    progress.end();
    outcome.map(|()| files)
}
