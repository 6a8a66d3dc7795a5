//! The shots of a video: cut at the boundaries in force, and each judged.

use std::path::Path;

use omnilife_schemas::{
    layout::SIGNALS_FILE,
    records::{Boundary, LedgerEntry, SphereLayout, TimeRange, VideoAnalysis},
};

use super::Samples;
use crate::{
    boundaries::{Detector, Signals},
    error::CurateError,
    ledger::{self, Ledger, labels},
    settings::CurateSettings,
    slicing::{self, Shots},
    sphere_layouts,
};

/// Boundaries and shots of a video.
pub(crate) struct ShotList {
    /// SHA-256 of the ledger from which the boundaries were resolved.
    pub(crate) ledger_sha256: Option<String>,
    pub(crate) boundaries: Vec<Boundary>,
    pub(crate) shots: Shots,
    /// Share, 0 to 1, of whole spheres by their own frames in the time of all shots that are long enough and show
    /// something.
    pub(crate) sphere_share: f64,
}

impl ShotList {
    /// Cuts and judges the shots. A shot that people keep by a label is not judged.
    ///
    /// # Errors
    /// When the ledger cannot be read, or the signals are not those of the detector.
    pub(crate) fn of(
        folder: &Path,
        analysis: &VideoAnalysis,
        detector: &Detector,
        settings: &CurateSettings,
        signals: &Signals,
        samples: &Samples,
    ) -> Result<Self, CurateError> {
        let kept = ledger::of_video(folder, &analysis.source.sha256)?;
        let entries: &[LedgerEntry] = match &kept {
            Some(kept) => kept.entries(),
            None => &[],
        };
        let boundaries = match &kept {
            Some(_) => ledger::resolve(entries),
            None => (detector.decide)(signals)
                .map_err(|error| CurateError::internal(&folder.join(SIGNALS_FILE), error))?,
        };
        let least = settings.minimum_shot_seconds;
        let mut shots = slicing::shots(&signals.times, analysis.range, &boundaries, least);
        shots.leave_out(|shot| labels::leaves_out(entries, shot));
        let check = |shot: TimeRange, judges_projection: bool| {
            if labels::keeps(entries, shot) {
                return None;
            }
            samples.rejected(shot, judges_projection)
        };
        let showing: Vec<TimeRange> = shots
            .kept
            .iter()
            .copied()
            .filter(|&shot| check(shot, false).is_none())
            .collect();
        let judges_projection = judges_projection(settings, analysis.layout);
        shots.reject(|shot| check(shot, judges_projection));
        Ok(Self {
            ledger_sha256: kept.as_ref().map(Ledger::sha256),
            boundaries,
            sphere_share: samples.sphere_share(&showing),
            shots,
        })
    }
}

/// Returns true if shots are judged by their projection. The user's own applies to the whole video, and half a sphere
/// neither closes around nor fills its frame.
fn judges_projection(settings: &CurateSettings, layout: Option<SphereLayout>) -> bool {
    let is_half = layout.is_some_and(sphere_layouts::is_half);
    settings.accept.is_none() && settings.layout.is_none() && !is_half
}
