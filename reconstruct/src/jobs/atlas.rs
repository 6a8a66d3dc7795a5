//! Images of a run's atlas.

use std::{path::Path, time::Instant};

use omnilife_schemas::{lock::FolderLock, progress::Progress, stage::StagePlan, store};

use crate::{
    error::ReconstructError,
    methods::neural_atlas::{outputs, saved},
};

/// Writes an RGBA image of each node of a run's atlas, and a list of them; returns the names of the files.
///
/// # Errors
/// When the run has no atlas, a file of someone else would be replaced, or one cannot be written.
pub fn export(
    run: &Path,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    if !run.join(saved::ATLAS_FILE).is_file() {
        return Err(ReconstructError::scene(
            run,
            "holds no atlas: it is no run of nag",
        ));
    }
    let graph = saved::read(run)?;
    store::create_folder(out)?;
    let _lock = FolderLock::take(out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(out, "atlas");
    let planned: Vec<String> = outputs::atlas_files(&graph);
    stage.claim(&planned)?;
    let files = outputs::write_atlas(graph, out)?;
    stage.finish(&files, begun.elapsed().as_secs_f64())?;
    Ok(files)
}
