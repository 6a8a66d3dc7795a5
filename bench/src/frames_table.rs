//! `frames.parquet`: the scores of every view.

use std::{fs::File, path::Path};

use omnilife_schemas::store::{self, StoreError};
use polars::prelude::{
    Column, DataFrame, NamedFrom, ParquetCompression, ParquetReader, ParquetWriter, PolarsResult,
    SerReader, Series,
};

use crate::{
    error::BenchError,
    scoring::job::{ScoreKey, ScoringJob, ViewOutcome},
};

/// File name of the table in the output folder.
pub(crate) const FRAMES_TABLE: &str = "frames.parquet";

/// Writes one row per view: `view` (`input` or `novel`), `frame`, `time_seconds` and one column
/// per metric. Metrics are null for a view that could not be scored, where they are undefined and
/// where they are unavailable.
pub(crate) fn write(
    path: &Path,
    job: &ScoringJob,
    outcomes: &[ViewOutcome],
) -> Result<(), BenchError> {
    let views: Vec<String> = outcomes.iter().map(|o| o.view.kind.to_string()).collect();
    let frames: Vec<u32> = outcomes.iter().map(|o| o.view.frame).collect();
    let times: Vec<f64> = frames
        .iter()
        .map(|&frame| job.scene.frames[frame as usize].time_seconds)
        .collect();
    let mut columns: Vec<Column> = vec![
        Series::new("view".into(), views).into(),
        Series::new("frame".into(), frames).into(),
        Series::new("time_seconds".into(), times).into(),
    ];
    let mut computed = 0;
    for metric in &job.metrics {
        let values: Vec<Option<f64>> = if metric.unavailable.is_some() {
            vec![None; outcomes.len()]
        } else {
            let value = |outcome: &ViewOutcome| outcome.scores.as_ref().ok()?[computed].ok();
            let values = outcomes.iter().map(value).collect();
            computed += 1;
            values
        };
        columns.push(Series::new(metric.metric.id.into(), values).into());
    }
    let mut table = DataFrame::new(outcomes.len(), columns)
        .map_err(|error| BenchError::internal(path, error.to_string()))?;
    store::write_with(path, |writer| {
        ParquetWriter::new(writer)
            .with_compression(ParquetCompression::Uncompressed)
            .finish(&mut table)
            .map(|_| ())
            .map_err(std::io::Error::other)
    })?;
    Ok(())
}

/// Reads every score that is there.
pub(crate) fn read(path: &Path) -> Result<Vec<(ScoreKey, f64)>, BenchError> {
    let file = File::open(path).map_err(|source| StoreError::read(path, source))?;
    let scores = ParquetReader::new(file)
        .finish()
        .and_then(|table| scores(&table));
    Ok(scores.map_err(|error| StoreError::malformed(path, error.to_string()))?)
}

fn scores(table: &DataFrame) -> PolarsResult<Vec<(ScoreKey, f64)>> {
    let views = table.column("view")?.str()?;
    let frames = table.column("frame")?.u32()?;
    let mut scores = Vec::new();
    for column in table.columns() {
        let name = column.name().as_str();
        if ["view", "frame", "time_seconds"].contains(&name) {
            continue;
        }
        let values = column.f64()?;
        for ((view, frame), value) in views.iter().zip(frames.iter()).zip(values.iter()) {
            if let (Some(view), Some(frame), Some(value)) = (view, frame, value) {
                let key = ScoreKey {
                    view: view.to_owned(),
                    metric: name.to_owned(),
                    frame,
                };
                scores.push((key, value));
            }
        }
    }
    Ok(scores)
}
