//! Masks that another program made, read at the size of a sequence's frames.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    camera::ErpCamera, mask_file::MarkedGreys, mask_survey::MaskSurvey, records::Sequence,
    rgb::Mask,
};

use super::{FrameMasks, MaskSet};
use crate::{error::CurateError, poses};

/// Reads a file per frame.
///
/// # Errors
/// When a file cannot be read or does not have the shape of its frame.
pub(super) fn read(files: &[PathBuf], sequence: &Sequence) -> Result<MaskSet, CurateError> {
    let frames = files.iter().map(|file| read_mask(file, sequence));
    Ok(MaskSet {
        frames: frames.collect::<Result<_, _>>()?,
        notes: notes(files, sequence)?,
    })
}

fn read_mask(file: &Path, sequence: &Sequence) -> Result<FrameMasks, CurateError> {
    let (width, height) = (
        sequence.frames.width as usize,
        sequence.frames.height as usize,
    );
    let mask = Mask::read(file)?;
    // Another aspect ratio means another projection, or another frame.
    if mask.width * height != mask.height * width {
        return Err(CurateError::input(file, "has not the shape of its frame"));
    }
    Ok(mask.resized_to_nearest(width, height).into())
}

/// Returns lines on assumptions about given masks, and on masks of no frame.
fn notes(files: &[PathBuf], sequence: &Sequence) -> Result<Vec<String>, CurateError> {
    let camera = ErpCamera::new(sequence.frames.width, sequence.frames.height);
    let mut survey = MaskSurvey::default();
    for file in files {
        survey.add(file, &camera.into(), MarkedGreys::AboveHalf)?;
    }
    let mut notes = survey.notes();
    let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    notes.extend(poses::masks::surplus(&files, "masks")?);
    Ok(notes)
}
