//! Verification of a submission without ground truth: its files are the packed ones, its numbers are possible, and its
//! means are those of its views.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    frame_scores::FrameScores,
    object_scores::ObjectScores,
    ownership::is_inside,
    records::{ObjectResults, ResultRecord, Submission, SubmittedResult, Summary},
    store::{self, StoreError},
};
use rayon::prelude::*;

use super::{RESULT_FILE, SUBMISSION_FILE, described, files_below, pack::submission_error, size};
use crate::{error::LeaderboardError, quantity::ViewKind, validate};

/// Largest relative difference of a mean from that of its views: both are f64 sums, in any order.
const TOLERANCE: f64 = 1e-9;

/// A submission whose files and numbers agree.
#[derive(Debug, Clone, PartialEq)]
pub struct VerifiedSubmission {
    /// Its folder.
    pub folder: PathBuf,
    /// Its record.
    pub submission: Submission,
    /// Its results, in the record's order, with their files.
    pub results: Vec<(PathBuf, ResultRecord)>,
}

/// Checks a submission's files against its record, and its results against themselves.
///
/// # Errors
/// When it holds no results or a link, a file is missing, changed or additional, a result is impossible or of another
/// method, or a mean is not that of the views.
pub fn verify(folder: &Path) -> Result<VerifiedSubmission, LeaderboardError> {
    let file = folder.join(SUBMISSION_FILE);
    // No file is opened before it is certain that no link leads out of the folder, or round in it.
    files_below(folder)?;
    let submission: Submission = store::read_record(&file)?;
    if submission.results.is_empty() {
        return Err(submission_error(&file, "holds no results".to_owned()));
    }
    let mut results = Vec::new();
    for entry in &submission.results {
        let refuse = |reason: String| Err(submission_error(&file, reason));
        for name in [&entry.folder]
            .into_iter()
            .chain(&entry.input_views)
            .chain(&entry.novel_views)
            .chain(entry.files.iter().map(|file| &file.file))
        {
            if !is_inside(name) {
                return refuse(format!("{name}: leads out of the submission"));
            }
        }
        check_files(&folder.join(&entry.folder), entry)?;
        let path = folder.join(&entry.folder).join(RESULT_FILE);
        let result: ResultRecord = store::read_record(&path)?;
        let stated = (
            &entry.scene,
            &entry.protocol,
            &entry.protocol_hash,
            entry.seed,
        );
        let found = (
            &result.scene,
            &result.protocol,
            &result.protocol_hash,
            result.seed,
        );
        if result.method != submission.card.method || stated != found {
            return refuse(format!(
                "{}: its result is of another method, scene, protocol or seed",
                entry.folder
            ));
        }
        // Tables show no scores of such a result, so nothing else checks them.
        let has_scores = !(result.input_views.is_empty() && result.novel_views.is_empty());
        if result.run_failure.is_some() && has_scores {
            return Err(submission_error(
                &path,
                "its run failed, and it has scores".to_owned(),
            ));
        }
        check_means(&path, &result)?;
        check_objects(&path, &result)?;
        results.push((path, result));
    }
    validate::validate(&results)?;
    Ok(VerifiedSubmission {
        folder: folder.to_owned(),
        submission,
        results,
    })
}

fn check_files(folder: &Path, entry: &SubmittedResult) -> Result<(), LeaderboardError> {
    let there = files_below(folder)?;
    if let Some(stray) = there
        .iter()
        .find(|name| entry.files.iter().all(|file| file.file != **name))
    {
        return Err(submission_error(
            &folder.join(stray),
            "was not packed".to_owned(),
        ));
    }
    for packed in &entry.files {
        // A file of another size need not be hashed.
        let has_size = size(folder, &packed.file)? == packed.bytes;
        if !has_size || described(folder, &packed.file)? != *packed {
            return Err(submission_error(
                &folder.join(&packed.file),
                "is not what was packed".to_owned(),
            ));
        }
    }
    Ok(())
}

/// Compares the means of results with the tables of views beside them. Results may stand without these tables, as in a
/// folder that keeps the records alone.
///
/// # Errors
/// When a table cannot be read, or gives another mean: one of both was changed since scoring.
pub(crate) fn check_means_of(results: &[(PathBuf, ResultRecord)]) -> Result<(), LeaderboardError> {
    let checked: Vec<Result<(), LeaderboardError>> = results
        .par_iter()
        .filter(|(path, result)| {
            let table = path.with_file_name(&result.frames_table);
            result.run_failure.is_none() && is_inside(&result.frames_table) && table.is_file()
        })
        .map(|(path, result)| check_means(path, result))
        .collect();
    // The first one in the order of the files.
    checked.into_iter().collect()
}

/// Compares every mean with that of its column in the table of views.
fn check_means(path: &Path, result: &ResultRecord) -> Result<(), LeaderboardError> {
    if !result.tables().all(|table| is_inside(table)) {
        return Err(submission_error(
            path,
            "its table of views or of objects lies elsewhere".to_owned(),
        ));
    }
    let table_path = path.with_file_name(&result.frames_table);
    let table = FrameScores::read(&table_path)?;
    for kind in ViewKind::ALL {
        for (metric, summary) in kind.scores(result) {
            let column = table.of(kind.name(), metric);
            let scores: Vec<f64> = column
                .ok_or_else(|| {
                    StoreError::malformed(&table_path, format!("has no column {metric}"))
                })?
                .collect();
            if let Some(reason) = difference(&scores, summary) {
                return Err(submission_error(
                    path,
                    format!("{metric} of the {} views {reason}", kind.name()),
                ));
            }
        }
    }
    Ok(())
}

/// Compares every object's mean with its rows in the table of objects, and those of classes with their objects'.
fn check_objects(path: &Path, result: &ResultRecord) -> Result<(), LeaderboardError> {
    let Some(objects) = &result.objects else {
        return Ok(());
    };
    let table_path = path.with_file_name(&objects.table);
    let table = ObjectScores::read(&table_path)?;
    for one in &objects.objects {
        for (metric, summary) in &one.scores {
            let column = table.of(&one.view, &one.object, metric).ok_or_else(|| {
                StoreError::malformed(&table_path, format!("has no column {metric}"))
            })?;
            let scores: Vec<f64> = column.collect();
            if let Some(reason) = difference(&scores, summary) {
                let object = format!("{metric} of {} in the {} views", one.object, one.view);
                return Err(submission_error(path, format!("{object} {reason}")));
            }
        }
    }
    let classes = ObjectResults::new(objects.table.clone(), objects.objects.clone()).classes;
    if classes != objects.classes {
        let reason = "scores of a class of objects are not the means of its objects";
        return Err(submission_error(path, reason.to_owned()));
    }
    Ok(())
}

fn difference(scores: &[f64], summary: &Summary) -> Option<String> {
    if scores.len() != summary.views as usize {
        let (count, views) = (scores.len(), summary.views);
        return Some(format!("is a mean of {views}, its table has {count}"));
    }
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    let off = (mean - summary.mean).abs();
    // Not "above": NaN is wrong too.
    let agrees = off <= TOLERANCE * summary.mean.abs().max(1.0);
    (!agrees).then(|| format!("is {}, its table gives {mean}", summary.mean))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use omnilife_schemas::{
        object_scores::{OBJECT_SCORES_FILE, ObjectRow},
        records::{ObjectClass, ObjectResult},
    };

    use super::*;

    type Change = fn(&mut ObjectResults);

    /// Returns a result with one vehicle in two views, of 20 and 30 dB.
    fn result() -> ResultRecord {
        let record = serde_json::json!({
            "method": "nag", "scene": "street", "scene_sha256": "00", "protocol": "input-view/3",
            "protocol_hash": "abc", "scored_size": [64, 32], "input_views": {}, "novel_views": {},
            "failures": [], "frames_table": "frames.csv", "warnings": []
        });
        let summary = serde_json::json!({
            "mean": 25.0, "standard_deviation": 7.0, "views": 2, "direction": "higher-is-better"
        });
        let summary: Summary = serde_json::from_value(summary).unwrap();
        let car = ObjectResult {
            view: "input".to_owned(),
            object: "car".to_owned(),
            class: ObjectClass::Vehicle,
            scores: [("psnr-object".to_owned(), summary)].into(),
        };
        let mut result: ResultRecord = serde_json::from_value(record).unwrap();
        result.objects = Some(ObjectResults::new(OBJECT_SCORES_FILE.to_owned(), vec![car]));
        result
    }

    #[test]
    fn means_of_objects_are_those_of_their_rows() {
        let folder = tempfile::tempdir().unwrap();
        let row = |frame, score| ObjectRow {
            view: "input".to_owned(),
            frame,
            object: "car".to_owned(),
            scores: vec![Some(score)],
        };
        let table = ObjectScores {
            metrics: vec!["psnr-object".to_owned()],
            rows: vec![row(0, 20.0), row(3, 30.0)],
        };
        table
            .write(&folder.path().join(OBJECT_SCORES_FILE))
            .unwrap();
        let check = |change: Change| {
            let mut result = result();
            change(result.objects.as_mut().unwrap());
            check_objects(&folder.path().join(RESULT_FILE), &result)
                .map_err(|error| error.to_string())
        };
        assert_eq!(check(|_| {}), Ok(()));
        let changes: [(Change, &str); 3] = [
            (
                |objects| {
                    for summary in objects.objects[0].scores.values_mut() {
                        summary.mean = 26.0;
                    }
                },
                "psnr-object of car in the input views is 26",
            ),
            (
                |objects| objects.classes[0].class = ObjectClass::Person,
                "not the means of its objects",
            ),
            (
                |objects| objects.objects[0].object = "bus".to_owned(),
                "is a mean of 2, its table has 0",
            ),
        ];
        for (change, reason) in changes {
            let error = check(change).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
    }
}
