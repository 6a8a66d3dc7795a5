//! Component: points for a scene without points, before any other component uses them.

use omnilife_schemas::records::ComponentDecision;

use crate::{
    baseline,
    components::{Decision, Supported},
    request::MethodRequest,
    scene::TrainingScene,
    seeds::swept,
};

/// Its name.
pub const ID: &str = "swept-points";

/// Share of a limit on the Gaussians for first points; the rest is for density control. Without a limit the
/// number of Gaussians grows with that of the points, as with given points.
const SHARE: f64 = 0.5;

/// Adds points of a spherical sweep between the input views to a scene without points. `None` for a method
/// without this component.
pub fn complete(
    scene: &mut TrainingScene,
    supported: Supported,
    request: &MethodRequest,
) -> Option<ComponentDecision> {
    if !supported.has(ID, request) {
        return None;
    }
    let wanted = Decision::new(true, "the scene has no points").resolved(ID, request);
    if !wanted.used {
        return Some(wanted);
    }
    let limit = request.options.maximum_gaussians();
    let maximum = limit.map_or_else(
        || baseline::default_maximum(scene),
        |limit| (SHARE * limit as f64) as u64,
    );
    let found = swept::points(scene, maximum as usize, request.seed);
    let decision = match found {
        Some(found) if !found.points.is_empty() => {
            let reason = format!(
                "the scene has none: {} from {} pairs of views ({} apart), {:.0} % of their pixels \
                 confirmed",
                found.points.len(),
                found.pairs,
                found.gap,
                100.0 * found.confirmed
            );
            scene.points = found.points;
            Decision::new(true, reason)
        }
        _ => Decision::new(
            false,
            "no two panoramas stand far enough apart to tell distances",
        )
        .settled(),
    };
    Some(decision.resolved(ID, request))
}
