//! Acceptance of submissions.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    records::{MethodCard, Verification},
    store::{self, StoreError},
};

use super::{
    RESULT_FILE, SUBMISSION_FILE, VERIFICATION_FILE, copy, pack::submission_error,
    verify::VerifiedSubmission,
};
use crate::{
    collect::{RecordFiles, collect},
    error::LeaderboardError,
    format::slug,
    validate,
};

/// Copies the results of a verified submission into a folder of results, without predictions and their former paths,
/// and returns their new paths. They appear there atomically, with the record of their verification.
///
/// # Errors
/// When the folder holds results that contradict them, or that claim the same rows, a submission of the same method by
/// other authors, or a file cannot be written.
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
    refuse_other_authors(&record, &verified.submission.card, results)?;
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

/// Refuses a card whose method has other authors in a folder of results: both would be one row, and one mean.
fn refuse_other_authors(
    record: &Path,
    card: &MethodCard,
    results: &Path,
) -> Result<(), LeaderboardError> {
    let held = RecordFiles::below(results)?.cards()?;
    // A later version may have one author more, or name them in another order.
    let is_of_others = |held: &&MethodCard| {
        held.authors != card.authors
            && !held
                .authors
                .iter()
                .any(|author| card.authors.contains(author))
    };
    let other = held
        .iter()
        .find(|held| held.method == card.method && is_of_others(held));
    match other {
        Some(other) => Err(submission_error(
            record,
            format!(
                "method {} is by {}, and in {} it is by {}; another method needs another name",
                card.method,
                card.authors.join(", "),
                results.display(),
                other.authors.join(", ")
            ),
        )),
        None => Ok(()),
    }
}
