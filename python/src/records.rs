//! Records as their JSON: checked and brought to the current version, with all fields.

use std::path::PathBuf;

use omnilife_bench::PROTOCOLS;
use omnilife_leaderboard::{
    AnswerFormat, LeaderboardError, QueryRequest, TABLES, render, results_table,
};
use omnilife_schemas::{
    camera::Camera,
    records::{Dataset, ExternalRun, Protocol, ResultRecord, RunRecord, Scene, Split, Tracks},
    store::{self, Record},
};
use pyo3::prelude::*;
use serde::Serialize;

use crate::{background, errors::Failure};

/// Reads a record of a kind: `scene`, `split`, `result`, `dataset`, `run`, `tracks` or `external-run`. Returns its
/// JSON.
#[pyfunction]
pub(crate) fn read_record(py: Python<'_>, kind: &str, path: PathBuf) -> PyResult<String> {
    let read = match kind {
        "scene" => json_of::<Scene>,
        "split" => json_of::<Split>,
        "result" => json_of::<ResultRecord>,
        "dataset" => json_of::<Dataset>,
        "run" => json_of::<RunRecord>,
        "tracks" => json_of::<Tracks>,
        "external-run" => json_of::<ExternalRun>,
        other => return Err(Failure::of_input(format!("{other}: no kind of record")).into()),
    };
    background::run(py, move |_| read(path))
}

fn json_of<T: Record>(path: PathBuf) -> Result<String, Failure> {
    let record: T = store::read_record(&path)?;
    text(&record)
}

/// Returns the results in a folder and below it, sorted by path: pairs of a path and the JSON of its record.
#[pyfunction]
pub(crate) fn results_below(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<(PathBuf, String)>> {
    background::run(py, move |_| {
        let results = omnilife_leaderboard::collect(&folder)?.into_iter();
        results
            .map(|(path, record)| Ok((path, text(&record)?)))
            .collect()
    })
}

/// Runs a query on the results in a folder; returns the rows as JSON, and lines on omitted results.
#[pyfunction]
pub(crate) fn query(
    py: Python<'_>,
    results: PathBuf,
    table: &str,
    by: Vec<String>,
    metrics: Vec<String>,
    conditions: Vec<String>,
    dataset: Option<PathBuf>,
) -> PyResult<(String, Vec<String>)> {
    let Some(table) = results_table(table) else {
        let names = TABLES.map(|table| table.name).join(", ");
        let reason = format!("{table:?} is not a table; there are {names}");
        return Err(Failure::of_input(reason).into());
    };
    background::run(py, move |_| {
        let answer = omnilife_leaderboard::query(&QueryRequest {
            results,
            dataset,
            table,
            by,
            metrics,
            conditions,
        })?;
        let rows = render(&answer, AnswerFormat::Json).map_err(LeaderboardError::from)?;
        Ok((String::from_utf8_lossy(&rows).into_owned(), answer.notes))
    })
}

/// Returns width and height in pixels of the scored images; camera and protocol are JSON.
#[pyfunction]
pub(crate) fn scored_size(camera: &str, protocol: &str) -> PyResult<[u32; 2]> {
    let camera: Camera = from_text(camera)?;
    let protocol: Protocol = from_text(protocol)?;
    let size = protocol.scored_size(&camera).map_err(Failure::of_input)?;
    Ok(size)
}

/// Returns the ids of the protocols with descriptions.
#[pyfunction]
pub(crate) fn protocols() -> Vec<(&'static str, &'static str)> {
    let entries = PROTOCOLS.iter();
    entries.map(|entry| (entry.id, entry.description)).collect()
}

/// Returns a record as JSON.
pub(crate) fn text<T: Serialize>(record: &T) -> Result<String, Failure> {
    serde_json::to_string(record).map_err(|error| Failure::of_input(error.to_string()))
}

/// Reads a part of a record from its JSON.
pub(crate) fn from_text<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, Failure> {
    serde_json::from_str(text).map_err(|error| Failure::of_input(error.to_string()))
}
