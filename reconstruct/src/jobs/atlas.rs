//! Images of the surfaces of a run's atlas.

use std::{path::Path, time::Instant};

use omnilife_schemas::{lock::FolderLock, progress::Progress, stage::StagePlan, store};

use crate::registry;
use omnilife_training::error::ReconstructError;

/// Writes an RGBA image of each surface of a run's model, and a list of them; returns the names of the files.
///
/// # Errors
/// When the run's model has no surfaces, a file of someone else would be replaced, or one cannot be written.
pub fn export(
    run: &Path,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let opened = registry::open_run(run)?;
    let Some(plan) = opened.model.textures() else {
        let reason = format!("is a run of {}, which has no atlas", opened.record.method);
        return Err(ReconstructError::scene(run, reason));
    };
    let planned = plan(run)?;
    store::create_folder(out)?;
    let _lock = FolderLock::take(out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(out, "atlas");
    stage.claim(&planned.files)?;
    (planned.write)(out)?;
    stage.finish(&planned.files, begun.elapsed().as_secs_f64())?;
    Ok(planned.files)
}
