//! Editing a run: a run like it, in another folder.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    lock::FolderLock, progress::Progress, records::RunRecord, stage::StagePlan, store,
};

use crate::{
    error::ReconstructError,
    jobs::reconstruct::{NOVEL_FOLDER, RUN_FILE},
    methods::run_formats::{self, EditRequest},
};

/// What to edit, how, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct EditRunRequest {
    /// The run's folder.
    pub run: PathBuf,
    /// The script; which edits there are is the method's.
    pub script: PathBuf,
    /// Folder of the edited run, another one.
    pub out: PathBuf,
}

/// Edits a run; returns what was done, line by line. The edited run can be rendered; its record says what
/// was done to it, and names no predictions.
///
/// # Errors
/// When the run's kind of model has no edits, the script makes no sense, a file of someone else would be
/// replaced, or one cannot be written.
pub fn edit(
    request: &EditRunRequest,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let record: RunRecord = store::read_record(&request.run.join(RUN_FILE))?;
    let format = run_formats::of_run(&request.run).ok_or_else(|| {
        let reason = format!("is a run of {}, which no script edits", record.method);
        ReconstructError::scene(&request.run, reason)
    })?;
    if is_same(&request.run, &request.out) {
        let reason = "is the run that is to be edited; choose another output";
        return Err(ReconstructError::scene(&request.out, reason));
    }
    store::create_folder(&request.out)?;
    let _lock = FolderLock::take(&request.out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(&request.out, "edit");
    stage.claim(format.files.iter().chain(&[RUN_FILE]))?;
    let (mut files, done) = (format.edit)(&EditRequest {
        run: &request.run,
        script: &request.script,
        out: &request.out,
    })?;
    let record = record.edited(done.iter().cloned(), NOVEL_FOLDER);
    store::write_record(&request.out.join(RUN_FILE), &record)?;
    files.push(RUN_FILE.to_owned());
    stage.finish(&files, begun.elapsed().as_secs_f64())?;
    Ok(done)
}

fn is_same(a: &Path, b: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    real(a).is_some() && real(a) == real(b)
}
