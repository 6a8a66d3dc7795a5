//! `frames.parquet`: the scores of every view.

use std::path::Path;

use omnilife_schemas::store;
use polars::prelude::{Column, DataFrame, NamedFrom, ParquetCompression, ParquetWriter, Series};

use crate::{error::BenchError, score::ViewOutcome, scoring_job::ScoringJob};

/// File name of the table in the output folder.
pub(crate) const FRAMES_TABLE: &str = "frames.parquet";

/// Writes one row per view: `view` (`input` or `novel`), `frame`, `time_seconds` and one column
/// per metric. Metrics are null for a view that could not be scored.
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
    for (index, metric) in job.metrics.iter().enumerate() {
        let values: Vec<Option<f64>> = outcomes
            .iter()
            .map(|outcome| outcome.scores.as_ref().ok().map(|scores| scores[index]))
            .collect();
        columns.push(Series::new(metric.id.into(), values).into());
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
