//! Overlays: what is painted over the picture, and what is always in it.
//!
//! A camera that moves changes the picture everywhere but where something moves with it. The pass
//! (`stability`) measures, per pixel and over frames between which the scene moved, how much of
//! the picture's gradients stays; `regions` gathers what stays into regions of the sphere and
//! says what each of them is. A tripod or the wearer's helmet (class `rig`) stays too, and is part
//! of the scene.

mod regions;
mod stability;

pub use stability::OverlayPass;

use omnilife_schemas::records::OverlayReport;

/// Frames between which the scene moved that are needed for a judgement.
const LEAST_MOVING_STEPS: u32 = 5;

/// Says which overlays a pass over an equirectangular video has found.
pub fn report(pass: &OverlayPass) -> OverlayReport {
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
