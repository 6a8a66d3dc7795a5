//! Undistorted frames, as files of the scene.

use std::path::Path;

use omnilife_schemas::{
    layout::STRAIGHT_FRAMES_FOLDER, progress::Progress, records::Sequence, staging::Staging,
    store::StoreError,
};
use rayon::prelude::*;

use super::{frame_camera::write_straight, lens::Straightening};
use crate::error::CurateError;

/// Stages the frames of a sequence; returns their files, relative to its folder.
///
/// # Errors
/// When a frame cannot be read, differs in size from the others, or cannot be written.
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
    progress.begin("frames without their lens", Some(count as u64));
    let outcome = sequence
        .frames
        .entries
        .par_iter()
        .zip(&places)
        .try_for_each(|(entry, place)| -> Result<(), StoreError> {
            write_straight(straightening, &folder.join(&entry.file), place)?;
            progress.advance(1);
            Ok(())
        });
    progress.end();
    outcome?;
    Ok(files)
}
