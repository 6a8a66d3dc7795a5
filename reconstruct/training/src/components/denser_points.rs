//! Component: points beside a scene's own, on surfaces that those leave bare, before anything else looks at
//! them.
//!
//! Points of structure from motion are few, and lie where images have corners. What they leave bare density
//! control has to grow into from afar, step by step; under a limit on the Gaussians it hardly gets there.

use omnilife_schemas::records::ComponentDecision;

use crate::{
    baseline,
    components::{Decision, Supported},
    request::MethodRequest,
    scene::TrainingScene,
    seeds::swept::{self, SweptPoints},
};

/// Its name.
pub const ID: &str = "denser-points";

/// Share of what a limit on the Gaussians leaves beside the scene's points that may be added; the rest is for
/// the sky, for what moves and for density control.
const SHARE_OF_ROOM: f64 = 0.75;
/// Share of the places on surfaces that have no point near from which on points are added
/// (docs/results/quality.md).
const LEAST_BARE_SHARE: f64 = 0.17;

/// Adds to a scene's points those that a spherical sweep between its input views finds where there are none,
/// where a method has this component. `None` where there is nothing to decide: a scene without points is
/// that of [`swept_points`](crate::components::swept_points).
pub fn complete(
    scene: &mut TrainingScene,
    supported: Supported,
    request: &MethodRequest,
) -> Option<ComponentDecision> {
    if scene.points.is_empty() || !supported.has(ID, request) {
        return None;
    }
    if !request.allows(ID) {
        return Some(Decision::not_looked_for().resolved(ID, request));
    }
    let Some(bare) = swept::bare_surfaces(scene) else {
        let reason = "no two panoramas stand far enough apart to tell distances";
        return Some(Decision::new(false, reason).settled().resolved(ID, request));
    };
    let reason = format!(
        "{:.0} % of {} places on surfaces that pairs of views agree on have no point near (limit {:.0} %)",
        100.0 * bare.share(),
        bare.places,
        100.0 * LEAST_BARE_SHARE,
    );
    let mut decision =
        Decision::new(bare.share() >= LEAST_BARE_SHARE, reason).resolved(ID, request);
    if decision.used {
        match swept::points(scene, wanted(scene, request), request.seed) {
            Some(found) => add(found, scene, &mut decision),
            None => {
                decision.used = false;
                decision.reason += "; no pair of views could be swept at full size";
            }
        }
    }
    Some(decision)
}

/// Adds what was found, and says so.
fn add(found: SweptPoints, scene: &mut TrainingScene, decision: &mut ComponentDecision) {
    decision.reason += &format!(
        ": {} points from {} pairs of views beside the scene's {}",
        found.points.len(),
        found.pairs,
        scene.points.len()
    );
    scene.added_points = found.points.len();
    scene.points.positions.extend(found.points.positions);
    scene.points.colours.extend(found.points.colours);
}

/// How many points may be added.
fn wanted(scene: &TrainingScene, request: &MethodRequest) -> usize {
    let limit = request.options.maximum_gaussians();
    let limit = limit.unwrap_or_else(|| baseline::default_maximum(scene));
    let room = limit.saturating_sub(scene.points.len() as u64);
    (SHARE_OF_ROOM * room as f64) as usize
}
