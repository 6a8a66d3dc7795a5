//! Exported Gaussians: a run's, or those of a file, in the frame of an asset's files.

use std::path::Path;

use glam::DVec3;
use omnilife_engine::{
    gaussians::{ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures},
    model::Model,
};
use omnilife_schemas::{
    Similarity,
    layout::RUN_FILE,
    progress::Progress,
    records::{AssetSource, InvalidGaussians, RunRecord},
    store,
};

use super::{
    ExportRequest,
    moments::Moments,
    viewer_limits::{Drawable, FileFrame, drawable},
    whole::whole,
};
use crate::registry;
use omnilife_training::{
    error::ReconstructError,
    formats::{self, exchange::SplatFormat},
    models::gaussians::Source,
};

/// Gaussians to be written.
pub(super) struct ExportedScene {
    pub(super) drawable: Drawable,
    pub(super) source: AssetSource,
    /// Counts of invalid Gaussians.
    pub(super) invalid: InvalidGaussians,
    /// Reason for a dynamic scene without moments.
    pub(super) without_moments: Option<String>,
}

impl ExportedScene {
    /// Opens the requested Gaussians, and counts the invalid ones.
    ///
    /// # Errors
    /// When the Gaussians cannot be read, or a viewer could draw none of them.
    pub(super) fn open(
        request: &ExportRequest,
        format: &SplatFormat,
        progress: &dyn Progress,
    ) -> Result<Self, ReconstructError> {
        let OpenedSource {
            mut model,
            record,
            frame,
            mut invalid,
            ..
        } = OpenedSource::open(request)?;
        let seconds = shown_moment(request, &model)?;
        let (moments, without_moments) = match moments(request, format, &mut model, &frame) {
            None => (None, None),
            Some(Ok(moments)) => (Some(moments), None),
            Some(Err(reason)) => (None, Some(format!("moments are left out: {reason}"))),
        };
        let mut gaussians = ActivatedGaussians::default();
        let at = Viewpoint::of_moment(seconds.unwrap_or(0.0));
        model.activate(&at, &TemporalFeatures::default(), &mut gaussians);
        drop(model);
        let mut drawable = if format.is_for_old_viewers {
            drawable(&gaussians, moments, &frame, &mut invalid)
        } else {
            whole(&gaussians, &frame, &mut invalid)
        };
        if let Some(kept) = &drawable.whole {
            format.ranges.count(kept, &mut drawable.changes);
        }
        for note in formats::notes_on(&request.gaussians, &invalid) {
            progress.note(&note);
        }
        if drawable.len() == 0 {
            let reason = match seconds {
                Some(seconds) => {
                    format!("has no Gaussian that a viewer could draw at {seconds} seconds")
                }
                None => "has no Gaussian that a viewer could draw".to_owned(),
            };
            return Err(ReconstructError::scene(&request.gaussians, reason));
        }
        let source = asset_source(request, record, seconds)?;
        Ok(Self {
            drawable,
            source,
            invalid,
            without_moments,
        })
    }
}

/// The model to be exported.
pub(super) struct OpenedSource {
    pub(super) model: Model,
    pub(super) normalization: Similarity,
    /// Record of a run; `None` for a file.
    pub(super) record: Option<RunRecord>,
    /// Frame of the asset's files, from normalized coordinates.
    pub(super) frame: FileFrame,
    /// Counts of invalid Gaussians.
    pub(super) invalid: InvalidGaussians,
}

impl OpenedSource {
    /// Opens the requested Gaussians.
    ///
    /// # Errors
    /// When they cannot be read.
    pub(super) fn open(request: &ExportRequest) -> Result<Self, ReconstructError> {
        let record = request
            .gaussians
            .is_dir()
            .then(|| run_with_splats(&request.gaussians));
        let record = record.transpose()?;
        let source = Source::open_in_place(&request.gaussians, record.as_ref())?;
        let mut invalid = InvalidGaussians::default();
        let model = source.model(&mut invalid)?;
        let normalization = source.normalization;
        let frame = FileFrame::new(
            up(request, record.as_ref())?,
            DVec3::from_array(normalization.offset),
            1.0 / normalization.scale,
        );
        Ok(Self {
            model,
            normalization,
            record,
            frame,
            invalid,
        })
    }
}

/// Returns the record of an export's source, of which levels show the moment `seconds`.
pub(super) fn asset_source(
    request: &ExportRequest,
    record: Option<RunRecord>,
    seconds: Option<f64>,
) -> Result<AssetSource, ReconstructError> {
    let sha256 = match &record {
        Some(_) => store::sha256_file(&request.gaussians.join(RUN_FILE))?,
        None => store::sha256_file(&request.gaussians)?,
    };
    Ok(AssetSource {
        sha256,
        method: record.as_ref().map(|record| record.method.clone()),
        scene: record.map(|record| record.scene),
        time_seconds: seconds,
    })
}

/// Returns the record of a run whose model web viewers can show.
fn run_with_splats(folder: &Path) -> Result<RunRecord, ReconstructError> {
    let run = registry::open_run(folder)?;
    if run.model.has_splats() {
        return Ok(run.record);
    }
    let reason = format!(
        "is a run of {}, which has no Gaussians for viewers",
        run.record.method
    );
    Err(ReconstructError::scene(folder, reason))
}

/// Returns the moment that levels show, if the scene depends on time.
///
/// # Errors
/// For a time outside of the clip.
fn shown_moment(request: &ExportRequest, model: &Model) -> Result<Option<f64>, ReconstructError> {
    let Some(span) = model.time_span() else {
        return Ok(None);
    };
    let seconds = request
        .time_seconds
        .unwrap_or_else(|| span.middle_seconds());
    let [begin, end] = [span.begin_seconds, span.end_seconds];
    if (begin..=end).contains(&seconds) {
        return Ok(Some(seconds));
    }
    let reason = format!("--time must be within the clip, {begin:.3} to {end:.3} s, got {seconds}");
    Err(ReconstructError::Request { reason })
}

/// Returns the moments of a dynamic scene; `None` for a static scene or for one moment.
fn moments(
    request: &ExportRequest,
    format: &SplatFormat,
    model: &mut Model,
    frame: &FileFrame,
) -> Option<Result<Moments, String>> {
    let span = model.time_span()?;
    if request.moments == Some(1) {
        return None;
    }
    if !format.is_for_old_viewers {
        return Some(Err(format!(
            "they are written as .splat, not as {}",
            format.name
        )));
    }
    let row = |gaussians: &ActivatedGaussians, index: usize| frame.row(gaussians, index);
    Some(Moments::of(model, &span, request.moments, row))
}

/// Returns up in the world.
fn up(request: &ExportRequest, record: Option<&RunRecord>) -> Result<DVec3, ReconstructError> {
    let given = request.up.or_else(|| record.and_then(|record| record.up));
    let up = DVec3::from_array(given.unwrap_or([0.0, 0.0, 1.0]));
    if up.is_finite() && up.length() > 1e-9 {
        return Ok(up);
    }
    Err(ReconstructError::Request {
        reason: format!("--up must be a direction, got {up}"),
    })
}
