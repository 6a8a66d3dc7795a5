//! Dry run of tracking: the decisions for a scene, reported without writing tracks.

use std::time::Instant;

use omnilife_schemas::{
    lock::FolderLock,
    progress::Progress,
    records::{ComponentDecision, Tracks},
    store,
};

use super::{
    TrackInputs, TrackRequest,
    distance::{DistanceMethod, has_estimates},
};
use crate::error::TracksError;

/// Used and omitted components, with the evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct TracksPlan {
    /// Id of the scene.
    pub scene: String,
    /// Component by component.
    pub decisions: Vec<ComponentDecision>,
    /// Further remarks of the tracks, for example on objects that are static.
    pub remarks: Vec<String>,
    /// Vehicles that move.
    pub moving: usize,
    /// True if tracks of the same inputs existed, which were read instead of the frames.
    pub is_known: bool,
    /// Wall-clock time of the analysis, seconds.
    pub wall_seconds: f64,
}

/// Decides how a scene is tracked. The evidence is in its frames: they are analysed as for tracks, unless tracks of the
/// same inputs exist. The output of the detector `command` is kept, and nothing else is written.
///
/// # Errors
/// Those of [`super::make_tracks`].
pub fn plan_tracks(
    request: &TrackRequest,
    progress: &dyn Progress,
) -> Result<TracksPlan, TracksError> {
    let begun = Instant::now();
    let asked = TrackInputs::read(request)?;
    let is_known = asked.stage(request)?.is_done();
    let tracks = if is_known {
        store::read_record(&asked.record(request))?
    } else {
        let lock = request.options.detector.keeps_files;
        let lock = lock.then(|| FolderLock::take(&request.out, progress));
        let _lock = lock.transpose()?;
        asked.track(request, progress)?
    };
    Ok(TracksPlan {
        scene: tracks.scene.clone(),
        decisions: decisions(request, &asked, &tracks),
        moving: tracks.tracks.len(),
        remarks: tracks.warnings,
        is_known,
        wall_seconds: begun.elapsed().as_secs_f64(),
    })
}

fn decisions(
    request: &TrackRequest,
    asked: &TrackInputs,
    tracks: &Tracks,
) -> Vec<ComponentDecision> {
    let decide = |component: &str, used: bool, reason: String| ComponentDecision {
        component: component.to_owned(),
        used,
        reason,
    };
    let stage = |name: &str| tracks.stages.iter().find(|stage| stage.stage == name);
    let reason = |name: &str| stage(name).map_or(String::new(), |stage| stage.reason.clone());
    let (are_dense, points) = match &asked.points {
        Some(points) => (!points.dense_frames.is_empty(), points.name.clone()),
        None => (false, "no dense points: the ground is a plane".to_owned()),
    };
    let scale = match (stage("scale"), request.options.metres_per_unit) {
        (Some(stage), _) => (true, stage.reason.clone()),
        (None, Some(metres)) => (false, format!("given: {metres} metres in a unit")),
        (None, None) => (false, "the scene is in metres".to_owned()),
    };
    let by_ground =
        stage("distance").is_none_or(|stage| stage.method == DistanceMethod::Ground.id());
    let without = if has_estimates(&asked.scene, &asked.views) {
        ""
    } else {
        "no depth prior; "
    };
    let appearance = match stage("appearance") {
        Some(stage) => (stage.reason.starts_with("kept"), stage.reason.clone()),
        None => (
            false,
            "chains on the ground go by places (--association deepsort looks at boxes)".to_owned(),
        ),
    };
    let curved = tracks
        .tracks
        .iter()
        .filter(|track| track.path.centre.degree >= 3);
    let splines = format!(
        "{} of {} paths are cubic, those of fewer than four detections are of lower degree; {}",
        curved.clone().count(),
        tracks.tracks.len(),
        reason("trajectory")
    );
    let moving = match tracks.tracks.len() {
        0 => "no vehicle moves: the static method is left".to_owned(),
        count => format!("{count} vehicles move"),
    };
    vec![
        decide("dense-points", are_dense, points),
        decide("metric-scale", scale.0, scale.1),
        decide(
            &format!("detector: {}", request.options.detector.id),
            true,
            reason("detector"),
        ),
        decide(
            "monocular-depth",
            !by_ground,
            format!("{without}{}", reason("distance")),
        ),
        decide(
            &format!("association: {}", request.options.association.id()),
            true,
            reason("association"),
        ),
        decide("appearance", appearance.0, appearance.1),
        decide("trajectory-spline", curved.count() > 0, splines),
        decide("object-graph", !tracks.tracks.is_empty(), moving),
    ]
}

impl TracksPlan {
    /// Returns the decisions as a Markdown table, and the static objects.
    pub fn text(&self) -> String {
        let mut text = format!("tracks of {}\n\n", self.scene);
        text += "| Component | Used | Evidence |\n|---|---|---|\n";
        for decision in &self.decisions {
            text += &format!(
                "| {} | {} | {} |\n",
                decision.component,
                if decision.used { "yes" } else { "no" },
                decision.reason
            );
        }
        text.push('\n');
        for remark in &self.remarks {
            text += &format!("{remark}\n");
        }
        let looked = if self.is_known {
            "by the tracks that are there".to_owned()
        } else {
            format!(
                "all stages were computed for this, in {:.1} s",
                self.wall_seconds
            )
        };
        text + &format!("{} vehicles move; {looked}\n", self.moving)
    }
}
