//! Component: steps of training leave Gaussians out.

use omnilife_engine::gaussians::dropout::Dropout;

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "dropout";

/// Share of the Gaussians that the last step leaves out, the published value.
const LAST_SHARE: f32 = 0.2;

pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Dropout of Gaussians",
    description: "Every step leaves other Gaussians out, in the end a fifth of them, and draws the rest more opaque \
                  (DropGaussian), so that none relies on others that only the input views see in front of \
                  it. Used where few input views see most points, under the plan full too.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| request.allows(ID),
    decide,
    apply,
};

fn decide(evidence: &SceneEvidence, _: &Draft<'_>) -> Decision {
    let decision = match &evidence.pilot {
        None => Decision::not_looked_for(),
        Some(pilot) => Decision::new(pilot.coverage.is_sparse(), pilot.coverage.to_string()),
    };
    // It adds nothing to a model: where many views see every point it only harms.
    decision.even_if_full()
}

fn apply(draft: &mut Draft<'_>) {
    draft.settings.dropout = Some(Dropout {
        last_share: LAST_SHARE,
        iterations: draft.settings.iterations,
        // Any 32 bits of the seed suffice.
        seed: draft.settings.seed as u32,
    });
}
