//! Reading of views and ground truths for the diagnosis.

use std::collections::BTreeSet;

use omnilife_schemas::{camera::Camera, store};
use rayon::prelude::*;

use super::{
    border::Border,
    copies::{self, Look, Truth, Truths},
    distances::{Distances, missing_share},
    images::{Small, psnr_db, reduced},
    shifts,
};
use crate::{
    error::BenchError,
    job::{ScoringJob, View},
    metrics::{DepthPair, Need, ViewPair},
    truth,
};

/// Columns of the reduced sizes: for rotations and colours, and for comparisons frame by frame.
pub(super) const SMALL: usize = 128;
const MEDIUM: usize = 256;
/// Least share of the values of arrays outside of [0, 1] for a finding.
pub(super) const TELLING_OUTSIDE: f64 = 0.05;
/// Memory for a pixel of a view during the diagnosis, bytes: two images in 8 bits, one in f32, and both in grey.
const BYTES_PER_PIXEL: u64 = 2 * 3 + 12 + 4 * 4;

/// Facts about a view that the findings need.
pub(super) struct ViewFacts {
    pub(super) view: View,
    /// Mean squared error over the pixels that count, of bytes, as dB.
    pub(super) psnr_db: f64,
    pub(super) small: Small,
    pub(super) medium: Small,
    /// Shifts of its parts, as [`shifts::by_part`] returns them.
    pub(super) shifts: Vec<Option<[f64; 2]>>,
    /// True if every pixel is doubled.
    pub(super) is_doubled: bool,
    /// Its border of a single colour.
    pub(super) border: Border,
    /// True if its file states other colours than sRGB.
    pub(super) states_other_colours: bool,
    /// Its predicted distances beside the true ones, where there are both.
    pub(super) distances: Option<Distances>,
    /// Share of the pixels with a true distance that have no predicted one.
    pub(super) distances_missing: Option<f64>,
    /// Share of the values of an array outside of [0, 1].
    pub(super) outside: Option<f64>,
    /// SHA-256 of the prediction's bytes.
    pub(super) sha256: String,
}

impl ViewFacts {
    /// Examines a pair; columns wrap if `wraps` is true.
    pub(super) fn of(view: View, pair: &ViewPair, wraps: bool) -> Self {
        Self {
            view,
            psnr_db: psnr_db(error(pair)),
            small: Small::of(pair, SMALL),
            medium: Small::of(pair, MEDIUM),
            shifts: shifts::by_part(pair, wraps),
            is_doubled: copies::is_doubled(pair),
            border: Border::of(pair),
            states_other_colours: false,
            distances: None,
            distances_missing: None,
            outside: None,
            sha256: store::sha256_bytes(pair.as_predicted()),
        }
    }
}

/// Returns the mean squared error over the pixels that count, of bytes.
fn error(pair: &ViewPair) -> f64 {
    let images = [pair.prediction(), pair.truth()].map(|image| image.as_chunks::<3>().0.iter());
    let [prediction, truth] = images;
    let (mut sum, mut count) = (0.0, 0_usize);
    for (pixel, (predicted, truth)) in prediction.zip(truth).enumerate() {
        if pair.counts(pixel) {
            let squares = predicted
                .iter()
                .zip(truth)
                .map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2));
            sum += squares.sum::<f64>();
            count += 3;
        }
    }
    sum / count.max(1) as f64
}

/// Examines views, as many at once as the memory allows; those with unreadable predictions are left out.
///
/// # Errors
/// When a ground truth or its mask is unusable.
pub(super) fn look(
    job: &ScoringJob,
    views: &[View],
    memory_bytes: u64,
) -> Result<Vec<ViewFacts>, BenchError> {
    let wraps = wraps(job);
    let mut looked = Vec::with_capacity(views.len());
    for views in views.chunks(at_once(job, memory_bytes)) {
        let found: Vec<Result<Option<ViewFacts>, BenchError>> = views
            .par_iter()
            .map(|&view| {
                let Some(pair) = read(job, view)? else {
                    return Ok(None);
                };
                let mut looked = ViewFacts::of(view, &pair, wraps);
                if let Some(folder) = job.folder(view.kind) {
                    looked.outside = folder.outside_share(view.frame);
                    looked.states_other_colours = folder.states_other_colours(view.frame);
                }
                if let Some(depth) = distances(job, view)? {
                    looked.distances = Distances::of(&pair, &depth);
                    looked.distances_missing = missing_share(&pair, &depth);
                }
                Ok(Some(looked))
            })
            .collect();
        let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
        looked.extend(found.into_iter().flatten());
    }
    Ok(looked)
}

/// Returns predicted distances of a view beside the true ones; `None` without both.
///
/// # Errors
/// When the true ones are unusable.
fn distances(job: &ScoringJob, view: View) -> Result<Option<DepthPair>, BenchError> {
    let folder = job
        .folder(view.kind)
        .filter(|folder| job.needs(Need::Depth) && folder.has_depth());
    let depth = &job.scene.frames[view.frame as usize].depth;
    let (Some(folder), Some(depth)) = (folder, depth) else {
        return Ok(None);
    };
    let [width, height] = job.size;
    let Ok(prediction) = folder.read_depth(view.frame, width, height) else {
        return Ok(None);
    };
    let truth = truth::read_depth(job, depth)?;
    Ok(Some(DepthPair { prediction, truth }))
}

/// Returns true if the columns of the scene's images wrap.
pub(super) fn wraps(job: &ScoringJob) -> bool {
    matches!(job.scene.camera, Camera::Erp(_))
}

/// Returns the number of views that fit into `memory_bytes`, at least one and at most one per thread.
fn at_once(job: &ScoringJob, memory_bytes: u64) -> usize {
    let [width, height] = job.size.map(u64::from);
    let fitting = memory_bytes / (width * height * BYTES_PER_PIXEL).max(1);
    usize::try_from(fitting)
        .unwrap_or(usize::MAX)
        .clamp(1, rayon::current_num_threads())
}

/// Reads a prediction with its ground truth; `None` if the prediction cannot be read.
///
/// # Errors
/// When the ground truth or its mask is unusable.
pub(super) fn read(job: &ScoringJob, view: View) -> Result<Option<ViewPair>, BenchError> {
    let [width, height] = job.size;
    let folder = job.folder(view.kind);
    let Some(Ok(prediction)) = folder.map(|folder| folder.read(view.frame, width, height)) else {
        return Ok(None);
    };
    let truth = truth::read(job, view.frame)?;
    let ignored = truth::read_ignore_mask(job, view.frame)?;
    Ok(truth::pair(job, prediction, truth, ignored.as_ref()))
}

/// Reads ground truths of frames, without missing and unreadable ones: frames that are not scored need none.
pub(super) fn truths(job: &ScoringJob, frames: &BTreeSet<u32>, memory_bytes: u64) -> Truths {
    let size = job.size.map(|side| side as usize);
    let known: Vec<u32> = frames
        .iter()
        .copied()
        .filter(|&frame| (frame as usize) < job.scene.frames.len())
        .collect();
    let mut truths = Truths::new();
    for frames in known.chunks(at_once(job, memory_bytes)) {
        let found: Vec<Option<(u32, Truth)>> = frames
            .par_iter()
            .map(|&frame| {
                let bytes = truth::read(job, frame).ok()?;
                let truth = Truth {
                    medium: reduced(&bytes, size, MEDIUM).1,
                    look: Look::of(&bytes, size),
                };
                Some((frame, truth))
            })
            .collect();
        truths.extend(found.into_iter().flatten());
    }
    truths
}
