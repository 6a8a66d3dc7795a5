//! Extracted frames that were edited in place.

use std::path::Path;

use omnilife_schemas::{
    ownership::NameState,
    plain_text,
    progress::Progress,
    records::{FrameEntry, Sequence},
    stage::StagePlan,
    store::{self, StoreError},
};

/// Name of the stage that extracts the frames of a sequence, and with it of its done-record.
pub(crate) const STAGE: &str = "frames";

/// Adds the frames of a sequence that were edited after they were extracted to the inputs of a stage, with a note: what
/// it found in the extracted ones is stale.
///
/// # Errors
/// When a frame cannot be read.
pub(crate) fn with_edited_frames(
    plan: StagePlan,
    (folder, sequence): (&Path, &Sequence),
    progress: &dyn Progress,
) -> Result<StagePlan, StoreError> {
    let own = StagePlan::new(folder, STAGE).own_files();
    let mut edited = Vec::new();
    let mut hashes = String::new();
    for FrameEntry { file, .. } in &sequence.frames.entries {
        if own.standing(file)? == NameState::Changed {
            hashes += &format!("{file} {}\n", store::sha256_file(&folder.join(file))?);
            edited.push(file.clone());
        }
    }
    if edited.is_empty() {
        return Ok(plan);
    }
    progress.note(&format!(
        "{}: frames edited after they were extracted: {} ({})",
        sequence.id,
        edited.len(),
        plain_text::first_of(&edited)
    ));
    Ok(plan.with_hash("edited frames", store::sha256_bytes(hashes.as_bytes())))
}
