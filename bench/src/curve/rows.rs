//! The rows of a trace, and the views of a run at them.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use omnilife_schemas::{records::RunRecord, store::StoreError};
use serde::{Deserialize, Serialize};

use crate::error::BenchError;

/// One row of a curve: the state of training, and the quality of the novel views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct CurveRow {
    /// Wall-clock time of the training steps so far.
    pub(crate) wall_seconds: f64,
    /// Wall-clock time of rendering the rows' views so far.
    pub(crate) evaluation_seconds: f64,
    /// CPU time of the training steps so far, if the system reports it.
    pub(crate) cpu_seconds: Option<f64>,
    pub(crate) iteration: u64,
    #[serde(alias = "gaussians")]
    pub(crate) primitives: u64,
    /// Objects that move as one, if the model distinguishes any.
    #[serde(default)]
    pub(crate) objects: Option<u64>,
    /// PSNR of some input views as training measured it, dB.
    #[serde(default)]
    pub(crate) input_psnr_db: Option<f64>,
    /// The same in static regions.
    #[serde(default)]
    pub(crate) input_psnr_static_db: Option<f64>,
    /// The same in dynamic regions.
    #[serde(default)]
    pub(crate) input_psnr_dynamic_db: Option<f64>,
    /// Number of scored novel views; a trace has none of them.
    #[serde(default)]
    pub(crate) novel_views: usize,
    /// Mean PSNR of these views, dB; none if one could not be scored.
    #[serde(default)]
    pub(crate) novel_psnr_db: Option<f64>,
    /// Mean SSIM of these views; as PSNR.
    #[serde(default)]
    pub(crate) novel_ssim: Option<f64>,
    /// Mean LPIPS (`AlexNet`) of these views, if the network's weights were available; as PSNR.
    #[serde(default)]
    pub(crate) novel_lpips_alex: Option<f64>,
    /// Mean PSNR of these views outside of the scene's masks of moving content, dB, if it has any.
    #[serde(default)]
    pub(crate) novel_psnr_static_db: Option<f64>,
    /// The same inside of these masks.
    #[serde(default)]
    pub(crate) novel_psnr_dynamic_db: Option<f64>,
    /// Opacity-weighted share of the Gaussians in the free space of two input views or more, if distances are known.
    #[serde(default)]
    pub(crate) ghost_share: Option<f64>,
    /// Share of the pixels of input views with a known distance that are more than half transparent.
    #[serde(default)]
    pub(crate) input_hole_share: Option<f64>,
    /// The same of novel views.
    #[serde(default)]
    pub(crate) novel_hole_share: Option<f64>,
}

/// A trace with the views at its rows.
pub(crate) struct Trace {
    file: PathBuf,
    pub(crate) rows: Vec<CurveRow>,
    /// Folder of views of each row.
    pub(crate) folders: Vec<PathBuf>,
    /// The frames with a view at every row.
    pub(crate) frames: Vec<u32>,
}

impl Trace {
    /// Reads the trace of a run; `None` if the run left no trace or no views.
    ///
    /// # Errors
    /// When the trace is malformed.
    pub(crate) fn of_run(file: &Path, run: &RunRecord) -> Result<Option<Self>, BenchError> {
        let (Some(trace), Some(views)) = (&run.trace, &run.trace_views) else {
            return Ok(None);
        };
        if views.frames.is_empty() {
            return Ok(None);
        }
        let trace = file.with_file_name(trace);
        let rows = read_rows(&trace)?;
        let folder = |row: &CurveRow| {
            file.with_file_name(if row.iteration == run.iterations {
                run.predictions.novel_views.clone()
            } else {
                format!("{}/{:06}", views.folder, row.iteration)
            })
        };
        Ok(Some(Self {
            folders: rows.iter().map(folder).collect(),
            rows,
            frames: views.frames.clone(),
            file: trace,
        }))
    }

    /// Lists the trace, and the views at its rows: everything that a curve depends on.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> + '_ {
        let views = self.folders.iter().flat_map(|folder| {
            let file = |frame: &u32| folder.join(format!("{frame:06}.png"));
            self.frames.iter().map(file)
        });
        std::iter::once(self.file.clone()).chain(views)
    }
}

pub(crate) fn read_rows(path: &Path) -> Result<Vec<CurveRow>, BenchError> {
    let text = std::fs::read(path).map_err(|source| StoreError::read(path, source))?;
    csv::Reader::from_reader(text.as_slice())
        .deserialize()
        .map(|row| row.map_err(|error| BenchError::mismatch(path, error.to_string())))
        .collect()
}
