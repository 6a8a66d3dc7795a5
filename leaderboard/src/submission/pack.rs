//! Packing of a method's results for submission.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    lock::LOCK_FILE,
    ownership::{FileList, OwnFile, OwnFiles, is_inside},
    records::{
        ExternalRun, MethodCard, QUICK_LOOK, ResultRecord, RunRecord, ScoredPredictions,
        Submission, SubmittedResult,
    },
    store::{self, StoreError, Unfinished},
};

use super::{RESULT_FILE, SUBMISSION_FILE, copy, described, files_below};
use crate::{collect, error::LeaderboardError, validate};

/// Folder of the results in a submission.
const RESULTS_FOLDER: &str = "results";
/// List of the files of a submission while it is moved to its place; removed when it is complete.
const UNFINISHED_FILE: &str = ".omnilife-unfinished.json";

/// Input and output of packing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PackRequest {
    /// Folder to search for results of the card's method.
    pub results: PathBuf,
    /// The card, TOML.
    pub card: PathBuf,
    /// Folder of the submission; created, or empty.
    pub out: PathBuf,
    /// True to pack incomplete results and quick looks too. They are rows without a rank in tables.
    pub with_failures: bool,
}

/// Packs all results of a method with the scored predictions. Their folders are stated in the results; for results of
/// older versions they are found through the record of the run beside the scores (`../run/run.json` or
/// `../run/external-run.json`).
///
/// # Errors
/// When the card cannot be read, there are no results of its method, or the folder is not empty. Also when a result is
/// impossible, or incomplete without permission, or a prediction is missing or was changed since scoring.
pub fn pack(request: &PackRequest) -> Result<Submission, LeaderboardError> {
    let card = read_card(&request.card)?;
    let mut results = collect(&request.results)?;
    results.retain(|(_, result)| result.method == card.method);
    if results.is_empty() {
        return Err(submission_error(
            &request.results,
            format!("holds no results of the card's method {}", card.method),
        ));
    }
    validate::validate(&results)?;
    let incomplete = (results.iter())
        .find_map(|(file, result)| Some((file, result.why_incomplete()?)))
        .filter(|_| !request.with_failures);
    if let Some((file, reason)) = incomplete {
        return Err(submission_error(
            file,
            format!(
                "is not complete: {reason}; with failures, it is packed as a row that is not ranked"
            ),
        ));
    }
    if let Some((file, metrics)) = quick_look(&results).filter(|_| !request.with_failures) {
        return Err(submission_error(
            file,
            format!(
                "must have all metrics of its protocol, but {metrics} {QUICK_LOOK}; score it without --metrics and \
                 --without-lpips; with failures, it is packed as a row that is not ranked"
            ),
        ));
    }
    results.sort_by(|(_, a), (_, b)| {
        let key = |result: &ResultRecord| {
            (
                result.scene.clone(),
                result.protocol_hash.clone(),
                result.seed,
            )
        };
        key(a).cmp(&key(b))
    });
    store::create_folder(&request.out)?;
    clear_unfinished(&request.out)?;
    if store::names_in(&request.out)?
        .iter()
        .any(|name| name != LOCK_FILE)
    {
        return Err(submission_error(
            &request.out,
            "is not empty; choose another folder".to_owned(),
        ));
    }
    let unfinished = Unfinished::beside(&request.out.join(RESULTS_FOLDER));
    let beside = unfinished.path();
    let packed = results
        .iter()
        .enumerate()
        .map(|(number, (file, result))| pack_result(beside, number, file, result))
        .collect::<Result<Vec<_>, _>>()?;
    let submission = Submission {
        card,
        results: packed,
    };
    publish(&request.out, beside, &submission)?;
    Ok(submission)
}

/// Returns the first result that scoring was told to leave metrics out of, and these in words.
fn quick_look(results: &[(PathBuf, ResultRecord)]) -> Option<(&Path, String)> {
    results.iter().find_map(|(file, result)| {
        let metrics: Vec<&str> = result.left_out_metrics().into_iter().collect();
        let verb = match metrics.len() {
            0 => return None,
            1 => "was",
            _ => "were",
        };
        Some((file.as_path(), format!("{} {verb}", metrics.join(", "))))
    })
}

/// Moves the results to their place and writes the record last: a folder with the record is complete.
fn publish(out: &Path, beside: &Path, submission: &Submission) -> Result<(), StoreError> {
    let unfinished = out.join(UNFINISHED_FILE);
    let files = submission.results.iter().flat_map(|result| {
        result.files.iter().map(|file| OwnFile {
            file: format!("{}/{}", result.folder, file.file),
            sha256: Some(file.sha256.clone()),
        })
    });
    let list = FileList {
        files: files.collect(),
    };
    store::write_record(&unfinished, &list)?;
    let target = out.join(RESULTS_FOLDER);
    store::rename(beside, &target).map_err(|source| StoreError::write(&target, source))?;
    store::write_record(&out.join(SUBMISSION_FILE), submission)?;
    store::remove(&unfinished)
}

/// Removes leftovers of an interrupted packing.
fn clear_unfinished(out: &Path) -> Result<(), StoreError> {
    store::remove_abandoned(out)?;
    let unfinished = out.join(UNFINISHED_FILE);
    if !unfinished.is_file() {
        return Ok(());
    }
    let list: FileList = store::read_record(&unfinished)?;
    if !out.join(SUBMISSION_FILE).exists() {
        OwnFiles::new(out, list.files).remove(|_| true)?;
    }
    store::remove(&unfinished)
}

/// Reads a method's card, TOML.
///
/// # Errors
/// When it cannot be read, lacks an entry, or has an unknown one.
pub fn read_card(path: &Path) -> Result<MethodCard, LeaderboardError> {
    let text = fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
    toml::from_str(&text).map_err(|error| {
        let message = error.message().lines().next().unwrap_or_default();
        submission_error(path, format!("must be a card in TOML: {message}"))
    })
}

/// Fills a folder of `results`.
fn pack_result(
    results: &Path,
    number: usize,
    file: &Path,
    result: &ResultRecord,
) -> Result<SubmittedResult, LeaderboardError> {
    let name = format!("{number:04}");
    let folder = results.join(&name);
    for table in result.tables() {
        copy(&file.with_file_name(table), &folder.join(table))?;
    }
    let [input_views, novel_views] = match &result.predictions {
        Some(predictions) => copy_scored(file, predictions, &folder)?,
        None => copy_found(file, &folder)?,
    };
    // Paths on the packing machine are private; those in the submission replace them.
    let predictions = (result.predictions.clone()).map(|predictions| ScoredPredictions {
        input_views: input_views.clone(),
        novel_views: novel_views.clone(),
        ..predictions
    });
    let packed = ResultRecord {
        predictions,
        ..result.clone()
    };
    store::write_record(&folder.join(RESULT_FILE), &packed)?;
    let files = files_below(&folder)?;
    Ok(SubmittedResult {
        folder: format!("{RESULTS_FOLDER}/{name}"),
        scene: result.scene.clone(),
        protocol: result.protocol.clone(),
        protocol_hash: result.protocol_hash.clone(),
        seed: result.seed,
        input_views,
        novel_views,
        files: files
            .iter()
            .map(|file| described(&folder, file))
            .collect::<Result<_, StoreError>>()?,
    })
}

/// Returns the name of the folder of a kind of view in a packed result.
fn packed_views(kind: &str) -> String {
    format!("predictions/{kind}")
}

/// Copies the predictions in a result's list, as scored; returns the folders of input and novel views in `target`.
fn copy_scored(
    result: &Path,
    predictions: &ScoredPredictions,
    target: &Path,
) -> Result<[Option<String>; 2], LeaderboardError> {
    let mut folders = [None, None];
    let of_kinds = [
        ("input", &predictions.input_views),
        ("novel", &predictions.novel_views),
    ];
    for ((kind, source), packed) in of_kinds.into_iter().zip(&mut folders) {
        let Some(source) = source else { continue };
        // A relative folder is relative to the result.
        let source = result.parent().unwrap_or(Path::new(".")).join(source);
        let to = packed_views(kind);
        for scored in predictions.files.iter().filter(|file| file.view == kind) {
            let from = source.join(&scored.file);
            if !is_inside(&scored.file) {
                let reason = format!("names a prediction {} outside of its folder", scored.file);
                return Err(submission_error(result, reason));
            }
            let found = store::sha256_file(&from).map_err(|_| {
                let reason = "cannot be read any more: it was there when its result was scored";
                submission_error(&from, reason.to_owned())
            })?;
            if found != scored.sha256 {
                let reason = "was changed since it was scored; score it again".to_owned();
                return Err(submission_error(&from, reason));
            }
            copy(&from, &target.join(&to).join(&scored.file))?;
        }
        // If all views are missing, the folder has no files, which scoring accepts as well.
        store::create_folder(&target.join(&to))?;
        *packed = Some(to);
    }
    Ok(folders)
}

/// Copies the predicted images of a result without a list; returns the folders of input and novel views in `target`.
fn copy_found(result: &Path, target: &Path) -> Result<[Option<String>; 2], LeaderboardError> {
    let mut folders = [None, None];
    let sources = ["input", "novel"].into_iter().zip(predictions(result)?);
    for ((kind, source), packed) in sources.zip(&mut folders) {
        let Some(source) = source else { continue };
        let to = packed_views(kind);
        for image in store::names_in(&source)? {
            let is_view = [".png", ".npy"]
                .iter()
                .any(|ending| image.ends_with(ending));
            if is_view && !image.starts_with('.') {
                copy(&source.join(&image), &target.join(&to).join(&image))?;
            }
        }
        *packed = Some(to);
    }
    Ok(folders)
}

/// Returns folders of the predicted input and novel views of a result.
fn predictions(result: &Path) -> Result<[Option<PathBuf>; 2], LeaderboardError> {
    let run = result
        .parent()
        .and_then(Path::parent)
        .unwrap_or(Path::new("."))
        .join("run");
    let (ours, external) = (run.join("run.json"), run.join("external-run.json"));
    if ours.is_file() {
        let record: RunRecord = store::read_record(&ours)?;
        let views = record.predictions;
        let input = views.input_views.map(|folder| run.join(folder));
        return Ok([input, Some(run.join(views.novel_views))]);
    }
    if external.is_file() {
        let record: ExternalRun = store::read_record(&external)?;
        let input = record.input_views.map(|folder| run.join(folder));
        return Ok([input, Some(run.join(record.novel_views))]);
    }
    Err(submission_error(
        result,
        format!(
            "its predictions are not known: it was scored by an older version, and {} has neither run.json nor \
             external-run.json; score it again",
            run.display()
        ),
    ))
}

pub(super) fn submission_error(path: &Path, reason: String) -> LeaderboardError {
    LeaderboardError::Submission {
        path: path.to_owned(),
        reason,
    }
}
