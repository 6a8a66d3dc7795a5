//! Images of the surfaces of a run's atlas.

use std::path::Path;

use omnilife_schemas::{progress::Progress, stage::StagePlan};

use crate::registry;
use omnilife_training::error::ReconstructError;

/// Writes an RGBA image of each surface of a run's model, and a list of them; returns the names of the files.
///
/// # Errors
/// When the run's model has no surfaces, a file of someone else would be replaced, or a file cannot be written.
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
    let stage = StagePlan::new(out, "atlas");
    stage.run(planned.files.clone(), progress, |made| {
        (planned.write)(out)?;
        made.add_all(&planned.files);
        Ok(planned.files)
    })
}
