//! Component: points that do not change carry no temporal parameters.

use crate::{
    components::{Component, Decision, Draft, Turn, mask_seeds},
    evidence::SceneEvidence,
    seeds::points,
};

/// Its name.
pub const ID: &str = "static-table";

/// Static table.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Static table",
    description: "Scene points at which nothing changes outside the masks become Gaussians without \
                  temporal parameters; what changes, such as shadows, and the seeds on the masks keep \
                  theirs. Used where there are seeds and light does not change everywhere, under the plan \
                  full too.",
    turn: Turn::AfterPoints,
    needs_pilot: |request, masks| {
        request.allows(ID) && request.allows(mask_seeds::ID) && masks.show_something()
    },
    decide,
    apply,
};

// A permanent point is not missing at other times. A point that changes outside the masks, such as a shadow, has
// to be absent at times (docs/results/dynamic.md).
fn decide(evidence: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    // Without evidence any point may move.
    if let Some(missing) = draft.missing(mask_seeds::ID) {
        return Decision::without(missing);
    }
    match &evidence.pilot {
        None => Decision::not_looked_for().even_if_full(),
        Some(pilot) => {
            let reason = format!("{}; {}", pilot.changing_light, pilot.changing);
            Decision::new(!pilot.changing_light.is_everywhere(), reason).even_if_full()
        }
    }
}

fn apply(draft: &mut Draft<'_>) {
    let Some(pilot) = &draft.evidence.pilot else {
        return;
    };
    let changes = &pilot.changing.changes;
    let changes: Vec<bool> = draft.point_indices.iter().map(|&at| changes[at]).collect();
    let (changing, lasting) = points::partition(&draft.points, &changes);
    let of_sky = std::mem::take(&mut draft.fixed);
    draft.fixed = points::join(lasting, of_sky);
    draft.points = changing;
    let numbered = draft.point_indices.iter().zip(&changes);
    draft.point_indices = numbered
        .filter(|(_, changes)| **changes)
        .map(|(&at, _)| at)
        .collect();
}
