//! Overlays: content painted over the image, or always in it.
//!
//! A moving camera changes the image everywhere except where something moves with it. The pass (`stability`) measures,
//! per pixel and over frames between which the scene moved, the share of the image's gradients that stays. `regions`
//! gathers stable pixels into regions of the sphere and classifies them. A tripod or the wearer's helmet (class `rig`)
//! stays too, and is part of the scene. A sky may stay with all that is around it, so the `surroundings` of what is
//! painted must move. Captions of a second average out over a video: `windows` of two steps show them.
//!
//! A mosaic that follows a face stays nowhere, but shows in single frames: `pixelation` finds its grid in one frame,
//! `moving_mosaics` gathers the finds of many.

mod blocks;
mod line_profiles;
mod moving_mosaics;
mod pixelation;
mod regions;
mod stability;
mod surroundings;
mod windows;

pub use moving_mosaics::MosaicPass;
pub use stability::OverlayPass;

use omnilife_schemas::records::{Overlay, OverlayReport};

/// Least number of frames between which the scene moved for a judgement.
const LEAST_MOVING_STEPS: u32 = 5;

/// Reports the overlays found by the passes over an equirectangular video.
pub fn report(pass: &OverlayPass, mosaics: &MosaicPass) -> OverlayReport {
    let mut report = what_stays(pass);
    let is_known = |seen: &Overlay| {
        report
            .overlays
            .iter()
            .any(|standing| moving_mosaics::is_same(standing, seen))
    };
    let moving = mosaics.overlay().filter(|seen| !is_known(seen));
    report.overlays.extend(moving);
    let mut captions = pass.windows().captions();
    captions.retain(|seen| {
        let mut standing = report.overlays.iter();
        !standing.any(|standing| moving_mosaics::is_at_same_place(standing, seen))
    });
    report.overlays.extend(captions);
    report.overlays.sort_by(|a, b| {
        b.solid_angle_steradians
            .total_cmp(&a.solid_angle_steradians)
    });
    report
}

fn what_stays(pass: &OverlayPass) -> OverlayReport {
    let moving_steps = pass.moving_steps();
    let Some(stability) = pass
        .stability()
        .filter(|_| moving_steps >= LEAST_MOVING_STEPS)
    else {
        return OverlayReport {
            unjudged: Some(format!(
                "the scene moved between {moving_steps} of {} looked-at pairs of frames, \
                 {LEAST_MOVING_STEPS} are needed to tell what is painted over it",
                pass.steps()
            )),
            moving_steps,
            overlays: Vec::new(),
        };
    };
    OverlayReport {
        unjudged: None,
        moving_steps,
        overlays: regions::find(&stability),
    }
}
