//! Splits and scores, as the commands `bench split` and `bench score` make them.

use std::path::PathBuf;

use omnilife_bench::{BenchError, MetricChoice, Predictions, ScoreRequest, Statement};
use pyo3::prelude::*;

use crate::{background, errors::Failure};

/// Splits the scene of a `scene.json` under a protocol and writes `out`.
#[pyfunction]
pub(crate) fn split_scene(
    py: Python<'_>,
    scene: PathBuf,
    protocol: String,
    out: PathBuf,
) -> PyResult<()> {
    background::run(py, move |_| {
        omnilife_bench::split_scene(&scene, &protocol, &out)?;
        Ok(())
    })
}

/// Arguments of `score`, as a dictionary with all of these keys.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Request {
    scene: PathBuf,
    split: PathBuf,
    /// Record of a run, instead of folders.
    run: Option<PathBuf>,
    novel_views: Option<PathBuf>,
    input_views: Option<PathBuf>,
    /// Id of the method; a run has its own.
    method: Option<String>,
    out: PathBuf,
    memory_bytes: u64,
    without_lpips: bool,
    /// Ids of metrics; empty for all.
    metrics: Vec<String>,
}

/// Scores predictions and writes the result into the folder `out`. Returns notes for the user, line by line.
#[pyfunction]
pub(crate) fn score(py: Python<'_>, request: Request) -> PyResult<Vec<String>> {
    background::run(py, move |link| {
        omnilife_bench::score(&request.of_bench()?, link)?;
        Ok(link.notes())
    })
}

impl Request {
    fn of_bench(self) -> Result<ScoreRequest, Failure> {
        let method = match (&self.run, self.method) {
            (_, Some(method)) => method,
            (Some(run), None) => {
                ScoreRequest::of_run(&self.scene, &self.split, run, &self.out)?.method
            }
            (None, None) => return Err(Failure::of_input("predictions need the name of a method")),
        };
        let metrics = match (self.without_lpips, self.metrics.as_slice()) {
            (true, _) => MetricChoice::WithoutNetworks,
            (false, []) => MetricChoice::All,
            (false, ids) => MetricChoice::only(ids).map_err(BenchError::from)?,
        };
        Ok(ScoreRequest {
            scene: self.scene,
            split: self.split,
            predictions: match self.run {
                Some(run) => Predictions::Run(run),
                None => Predictions::Folders {
                    input_views: self.input_views,
                    novel_views: self.novel_views,
                },
            },
            method,
            statement: Statement::default(),
            out: self.out,
            memory_bytes: self.memory_bytes,
            metrics,
        })
    }
}
