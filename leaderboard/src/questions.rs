//! Queries on the results in a folder, and the tables for them beside a leaderboard.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_results::{Answer, Filter, Query, SceneFacts, Source, TABLES, Table, ask};
use omnilife_schemas::{
    frame_scores::FRAME_SCORES_FILE,
    layout::CURVE_FILE,
    records::{Dataset, ResultRecord},
    store,
};

use crate::{
    collect::RecordFiles, error::LeaderboardError, group, layouts, outputs::Outputs, repeats,
    submission,
};

/// A query as users state it.
#[derive(Debug, Clone)]
pub struct QueryRequest {
    /// Folder to search for `result.json` files.
    pub results: PathBuf,
    /// `dataset.json` with annotations of the scenes.
    pub dataset: Option<PathBuf>,
    /// The queried table.
    pub table: &'static Table,
    /// Columns to group by.
    pub by: Vec<String>,
    /// Metrics to average.
    pub metrics: Vec<String>,
    /// Conditions, `third=2,3`.
    pub conditions: Vec<String>,
}

/// Answers a query.
///
/// # Errors
/// When a record or table cannot be read, results contradict each other, or the query is invalid for them.
pub fn query(request: &QueryRequest) -> Result<Answer, LeaderboardError> {
    let filters = (request.conditions.iter())
        .map(|text| Filter::parse(text, request.table))
        .collect::<Result<_, _>>()?;
    let results = RecordFiles::below(&request.results)?.results()?;
    let groups = group::groups(&results)?;
    if request.table.source_file() == FRAME_SCORES_FILE {
        submission::check_means_of(&results)?;
    }
    let facts = scene_facts(request.dataset.as_deref())?;
    let query = Query {
        table: request.table,
        by: request.by.clone(),
        metrics: request.metrics.clone(),
        filters,
    };
    let mut answer = ask(&query, &sources(&results, &facts))?;
    if request.table.source_file() == CURVE_FILE {
        answer.notes.extend(curves_left_out(&results)?);
    }
    for group in &groups {
        answer.notes.extend(repeats::warnings(group));
        let remarks = layouts::remarks_of(group);
        answer.notes.extend(remarks.diagnoses);
    }
    Ok(answer)
}

fn curves_left_out(
    results: &[(PathBuf, ResultRecord)],
) -> Result<Option<String>, LeaderboardError> {
    let results = results
        .iter()
        .map(|(file, result)| (file.as_path(), result));
    Ok(omnilife_results::curves_left_out(results)?)
}

/// Reads a dataset's facts of its scenes; nothing without one.
pub(crate) fn scene_facts(
    dataset: Option<&Path>,
) -> Result<BTreeMap<String, SceneFacts>, LeaderboardError> {
    let Some(file) = dataset else {
        return Ok(BTreeMap::new());
    };
    let dataset: Dataset = store::read_record(file)?;
    Ok(omnilife_results::read_scene_facts(file, &dataset)?)
}

fn sources<'a>(
    results: &'a [(PathBuf, ResultRecord)],
    facts: &'a BTreeMap<String, SceneFacts>,
) -> Vec<Source<'a>> {
    let mut sources: Vec<Source<'_>> = results
        .iter()
        .map(|(file, result)| Source::new(file, result, facts.get(&result.scene)))
        .collect();
    let key = |source: &Source<'a>| {
        let result = source.result;
        let protocol = (&result.protocol, &result.protocol_hash);
        (protocol, &result.scene, &result.method, result.seed)
    };
    sources.sort_by(|a, b| key(a).cmp(&key(b)));
    sources
}

/// Adds the tables that have rows, as `<table>.parquet`, and returns lines on missing ones.
pub(crate) fn add_tables(
    outputs: &mut Outputs,
    results: &[(PathBuf, ResultRecord)],
    facts: &BTreeMap<String, SceneFacts>,
) -> Result<Vec<String>, LeaderboardError> {
    let sources = sources(results, facts);
    let mut notes = Vec::from_iter(curves_left_out(results)?);
    for table in TABLES {
        let written = omnilife_results::write_table(table, &sources)?;
        if let Some(bytes) = written.bytes {
            outputs.add(table.file(), bytes);
        }
        if table.of_every_result && written.without > 0 {
            notes.push(format!(
                "{}: {} of {} results have no {} beside them",
                table.file(),
                written.without,
                sources.len(),
                table.source_file()
            ));
        }
    }
    Ok(notes)
}
