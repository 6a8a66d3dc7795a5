//! Edits of a run: a run like it, in another folder, whose record lists the changes. It is never scored against
//! the video.

use std::path::{Path, PathBuf};

use omnilife_schemas::{layout::RUN_FILE, progress::Progress, stage::StagePlan};

use crate::{jobs::reconstruct::NOVEL_FOLDER, registry};
use omnilife_training::{
    error::ReconstructError,
    models::{EditPurpose, script::Script},
};

/// Run to edit, its script, and the folder of the edited run.
#[derive(Debug, Clone, PartialEq)]
pub struct EditRequest {
    /// The run's folder.
    pub run: PathBuf,
    /// The script.
    pub script: PathBuf,
    /// Folder of the edited run, another one.
    pub out: PathBuf,
    /// Use of the edited run.
    pub purpose: EditPurpose,
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
    let script = Script::read(&request.script)?;
    let edited = edit(&request.run, &record, &script, request.purpose)?;
    for warning in edited.warnings {
        progress.note(&format!("warning: {}: {warning}", request.out.display()));
        record.warnings.push(warning);
    }
    let planned = edited.planned;
    let files = planned.files.iter().map(String::as_str);
    let files: Vec<&str> = files.chain([RUN_FILE]).collect();
    StagePlan::new(&request.out, "edit").run(files, progress, |out| {
        (planned.write)(&request.out)?;
        out.add_all(&planned.files);
        let record = record.edited(edited.changes.iter().cloned(), NOVEL_FOLDER);
        out.write_record(RUN_FILE, &record)?;
        Ok(edited.changes)
    })
}

fn is_same(a: &Path, b: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    real(a).is_some() && real(a) == real(b)
}
