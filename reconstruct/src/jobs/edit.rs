//! Editing a run: a run like it, in another folder, whose record says what was done. It is never scored against
//! the video.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    lock::FolderLock, progress::Progress, records::RunRecord, stage::StagePlan, store,
};

use crate::{
    error::ReconstructError,
    jobs::{
        edit_objects::{self, CheckedEdit, ObjectEdit},
        reconstruct::{NOVEL_FOLDER, RUN_FILE},
    },
    methods::run_formats::{self, EditRequest},
};

/// Changes of a model.
#[derive(Debug, Clone, PartialEq)]
pub enum Changes {
    /// Those of a script; which there are is the method's.
    Script(PathBuf),
    /// Those of the objects of an object graph, in their order.
    Objects(Vec<ObjectEdit>),
}

/// A run to edit, its changes, and the folder of the edited run.
#[derive(Debug, Clone, PartialEq)]
pub struct EditRunRequest {
    /// The run's folder.
    pub run: PathBuf,
    /// Changes.
    pub changes: Changes,
    /// Folder of the edited run, another one.
    pub out: PathBuf,
}

/// Edits a run; returns what was done, line by line. The edited run can be rendered; its record says what
/// was done to it, and names no predictions.
///
/// # Errors
/// When the run's kind of model has no such edits, a change makes no sense, a file of someone else would be
/// replaced, or one cannot be written.
pub fn edit(
    request: &EditRunRequest,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let mut record: RunRecord = store::read_record(&request.run.join(RUN_FILE))?;
    if is_same(&request.run, &request.out) {
        let reason = "is the run that is to be edited; choose another output";
        return Err(ReconstructError::scene(&request.out, reason));
    }
    let checked = match &request.changes {
        Changes::Script(script) => of_script(&request.run, &record, script)?,
        Changes::Objects(edits) => edit_objects::check(&request.run, &record, edits)?,
    };
    for warning in checked.warnings {
        progress.note(&format!("{}: {warning}", request.out.display()));
        record.warnings.push(warning);
    }
    store::create_folder(&request.out)?;
    let _lock = FolderLock::take(&request.out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(&request.out, "edit");
    stage.claim(checked.files.iter().chain(&[RUN_FILE]))?;
    let (mut files, done) = (checked.write)(&request.out)?;
    let record = record.edited(done.iter().cloned(), NOVEL_FOLDER);
    store::write_record(&request.out.join(RUN_FILE), &record)?;
    files.push(RUN_FILE.to_owned());
    stage.finish(&files, begun.elapsed().as_secs_f64())?;
    Ok(done)
}

fn of_script<'a>(
    run: &'a Path,
    record: &RunRecord,
    script: &'a Path,
) -> Result<CheckedEdit<'a>, ReconstructError> {
    let format = run_formats::of_run(run).ok_or_else(|| {
        let reason = format!("is a run of {}, which no script edits", record.method);
        ReconstructError::scene(run, reason)
    })?;
    Ok(CheckedEdit {
        files: format.files.to_vec(),
        warnings: Vec::new(),
        write: Box::new(move |out| (format.edit)(&EditRequest { run, script, out })),
    })
}

fn is_same(a: &Path, b: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    real(a).is_some() && real(a) == real(b)
}
