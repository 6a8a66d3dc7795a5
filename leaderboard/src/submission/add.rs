//! Acceptance of submissions.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    records::Verification,
    store::{self, StoreError},
};

use super::{
    RESULT_FILE, SUBMISSION_FILE, VERIFICATION_FILE, copy, pack::submission_error,
    verify::VerifiedSubmission,
};
use crate::{collect, error::LeaderboardError, format::slug, validate};

/// Copies the results of a verified submission into a folder of results, without predictions and their former paths,
/// and returns their new paths. They appear there atomically, with the record of their verification.
///
/// # Errors
/// When the folder holds results that contradict them, or that claim the same rows, or a file cannot be written.
pub fn add(
    verified: &VerifiedSubmission,
    verification: &Verification,
    results: &Path,
) -> Result<PathBuf, LeaderboardError> {
    let record = verified.folder.join(SUBMISSION_FILE);
    let name = format!(
        "{}-{:.12}",
        slug(&verified.submission.card.method),
        store::sha256_file(&record)?
    );
    let target = results.join(&name);
    if target.exists() {
        return Err(submission_error(
            &record,
            format!("was added before, as {}", target.display()),
        ));
    }
    store::create_folder(results)?;
    let mut all = match collect(results) {
        Ok(held) => held,
        Err(LeaderboardError::NoResults { .. }) => Vec::new(),
        Err(error) => return Err(error),
    };
    all.extend(verified.results.iter().cloned());
    validate::validate(&all)?;
    // Hidden folders hold no results.
    let beside = results.join(format!(".adding-{name}"));
    store::remove(&beside)?;
    for (entry, (file, result)) in verified.submission.results.iter().zip(&verified.results) {
        let folder = beside.join(&entry.folder);
        copy(file, &folder.join(RESULT_FILE))?;
        for table in result.tables() {
            copy(&file.with_file_name(table), &folder.join(table))?;
        }
    }
    copy(&record, &beside.join(SUBMISSION_FILE))?;
    store::write_record(&beside.join(VERIFICATION_FILE), verification)?;
    store::rename(&beside, &target).map_err(|source| StoreError::write(&target, source))?;
    Ok(target)
}
