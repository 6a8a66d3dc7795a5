//! Edits of a run: a run like it, in another folder, whose record lists the changes. It is never scored against
//! the video.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    layout::RUN_FILE, lock::FolderLock, progress::Progress, stage::StagePlan, store,
};

use crate::{jobs::reconstruct::NOVEL_FOLDER, registry};
use omnilife_training::{error::ReconstructError, models::script::Script};

/// Run to edit, its script, and the folder of the edited run.
#[derive(Debug, Clone, PartialEq)]
pub struct EditRequest {
    /// The run's folder.
    pub run: PathBuf,
    /// The script.
    pub script: PathBuf,
    /// Folder of the edited run, another one.
    pub out: PathBuf,
}

/// Edits a run; returns the changes, one line each. The edited run can be rendered; its record lists the changes and
/// names no predictions.
///
/// # Errors
/// When the run's model cannot be edited, a change makes no sense, a file of someone else would be replaced, or one
/// cannot be written. All changes are checked before anything is written.
pub fn edit(
    request: &EditRequest,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    if is_same(&request.run, &request.out) {
        let reason = "is the run that is to be edited; choose another output";
        return Err(ReconstructError::scene(&request.out, reason));
    }
    let opened = registry::open_run(&request.run)?;
    let mut record = opened.record;
    let Some(edit) = opened.model.edit else {
        let reason = format!(
            "is a run of {}, whose model has no parts to edit",
            record.method
        );
        return Err(ReconstructError::scene(&request.run, reason));
    };
    let edited = edit(&request.run, &record, &Script::read(&request.script)?)?;
    for warning in edited.warnings {
        progress.note(&format!("{}: {warning}", request.out.display()));
        record.warnings.push(warning);
    }
    store::create_folder(&request.out)?;
    let _lock = FolderLock::take(&request.out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(&request.out, "edit");
    let mut files = edited.planned.files;
    files.push(RUN_FILE.to_owned());
    stage.claim(&files)?;
    (edited.planned.write)(&request.out)?;
    let record = record.edited(edited.changes.iter().cloned(), NOVEL_FOLDER);
    store::write_record(&request.out.join(RUN_FILE), &record)?;
    stage.finish(&files, begun.elapsed().as_secs_f64())?;
    Ok(edited.changes)
}

fn is_same(a: &Path, b: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    real(a).is_some() && real(a) == real(b)
}
