//! Component: points beside a scene's own, on bare surfaces, before any other component uses them.
//!
//! Points of structure from motion are few, and lie where images have corners. Density control has to grow into
//! bare surfaces from afar, step by step. Under a limit on the Gaussians it rarely gets there.

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

/// Maximum share of the room that a limit on the Gaussians leaves beside the scene's points. The rest is for the
/// sky, the dynamic region and density control.
const SHARE_OF_ROOM: f64 = 0.75;
/// Minimum share of places on surfaces without a near point, for adding points (docs/results/quality.md).
const LEAST_BARE_SHARE: f64 = 0.17;

/// Adds points to a scene, where a method has this component: points of a spherical sweep between the input
/// views, on bare surfaces. `None` without a decision: a scene without points belongs to
/// [`swept_points`](crate::components::swept_points).
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
    let mut decision = Decision::new(bare.share() >= LEAST_BARE_SHARE, reason)
        .even_if_full()
        .resolved(ID, request);
    if decision.used {
        let wanted = wanted(scene, request);
        match swept::points(scene, wanted, request.seed) {
            Some(found) if found.points.is_empty() => {
                decision.used = false;
                decision.reason += &format!("; none is added, where there is room for {wanted}");
            }
            Some(found) => add(found, scene, &mut decision),
            None => {
                decision.used = false;
                decision.reason += "; no pair of views could be swept at full size";
            }
        }
    }
    Some(decision)
}

/// Adds the points, and records them in the decision.
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

/// Returns the maximum number of added points.
fn wanted(scene: &TrainingScene, request: &MethodRequest) -> usize {
    let limit = request.options.maximum_gaussians();
    let limit = limit.unwrap_or_else(|| baseline::default_maximum(scene));
    let room = limit.saturating_sub(scene.points.len() as u64);
    (SHARE_OF_ROOM * room as f64) as usize
}
