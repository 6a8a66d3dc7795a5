//! Overlays: content painted over the image, or always in it.
//!
//! A moving camera changes the image everywhere except where something moves with it. The pass (`stability`) measures,
//! per pixel and over frames between which the scene moved, the share of the image's gradients that stays. `regions`
//! gathers stable pixels into regions of the sphere and classifies them. A tripod or the wearer's helmet (class `rig`)
//! stays too, and is part of the scene. A sky may stay with all that is around it, so the `surroundings` of what is
//! painted must move. Captions of a second average out over a shot: `captions` finds them by `runs` of constant strokes
//! that begin and end together.
//!
//! No sum runs over a shot boundary: the pass keeps its sums in `parts` between candidate `cuts`. Once boundaries are
//! confirmed, the parts of each shot are joined and judged, and the finds of all shots are gathered (`by_shot`). Where no
//! shot is long enough, all of them are judged together.
//!
//! A mosaic that follows a face stays nowhere, but shows in single frames: `pixelation` finds its grid in one frame,
//! `moving_mosaics` gathers the finds of many.

mod blocks;
mod by_shot;
mod captions;
mod cuts;
mod line_profiles;
mod moving_mosaics;
mod parts;
mod pixelation;
mod regions;
mod runs;
mod stability;
mod surroundings;

pub use moving_mosaics::MosaicPass;
pub use stability::OverlayPass;

use omnilife_schemas::records::{Boundary, Overlay, OverlayReport};

/// Least number of looked-at pairs of frames of a shot between which the scene moved for a judgement. In spans of
/// `tunnel`, on which nothing is painted, something of 0.02 sr stays for 5 to 8 steps (27 of 30 spans) and nothing for
/// 10 or more (none of 7).
const LEAST_MOVING_STEPS: u32 = 12;

/// Rules of judgement, part of the cache key of the analysis.
pub(crate) const SETTINGS: &str = "by shot, else as a whole, 12 moving steps; captions that begin and end together, \
     of resting scenes within a shot alone";

/// Reports the overlays found by the passes over an equirectangular video with these shot boundaries, in order of time.
pub fn report(pass: &OverlayPass, mosaics: &MosaicPass, boundaries: &[Boundary]) -> OverlayReport {
    let mut report = what_stays(pass, boundaries);
    let is_known = |seen: &Overlay| {
        report
            .overlays
            .iter()
            .any(|standing| moving_mosaics::is_same(standing, seen))
    };
    let moving = mosaics.overlay().filter(|seen| !is_known(seen));
    report.overlays.extend(moving);
    let mut captions = pass.captions().captions(boundaries, &report.spans);
    captions.retain(|seen| {
        let mut standing = report.overlays.iter();
        !standing.any(|standing| by_shot::stands_for(standing, seen))
    });
    report.overlays.extend(captions);
    report.overlays.sort_by(|a, b| {
        b.solid_angle_steradians
            .total_cmp(&a.solid_angle_steradians)
    });
    report
}

fn what_stays(pass: &OverlayPass, boundaries: &[Boundary]) -> OverlayReport {
    let shots = pass.pieces(boundaries);
    let is_any_judged = shots.iter().any(|piece| piece.overlays.is_some());
    // Shots that are all too short are judged together: what is painted over all of them stays.
    let pieces = if is_any_judged {
        shots
    } else {
        pass.pieces(&[])
    };
    let spans = by_shot::spans(&pieces, boundaries);
    let moving_steps: u32 = spans.iter().map(|span| span.moving_steps).sum();
    let is_judged = spans.iter().any(|span| span.is_judged);
    let unjudged = (!is_judged).then(|| {
        format!(
            "the scene moved between {moving_steps} of {} looked-at pairs of frames, \
             {LEAST_MOVING_STEPS} are needed to tell what is painted over it",
            pass.steps()
        )
    });
    OverlayReport {
        unjudged,
        moving_steps,
        overlays: by_shot::gathered(pieces),
        spans,
    }
}
