//! Component: steps of training leave Gaussians out.

use omnilife_engine::gaussians::dropout::Dropout;

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "dropout";

/// Share of the Gaussians that a step leaves out (docs/results/quality.md).
const SHARE: f32 = 0.1;

/// Dropout.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Dropout of Gaussians",
    description: "Every step leaves another tenth of the Gaussians out and draws the others more opaque \
                  (DropGaussian), so that none relies on others that only the input views see in front of \
                  it. Used where few input views see most points.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| request.allows(ID),
    decide,
    apply,
};

fn decide(evidence: &SceneEvidence, _: &Draft<'_>) -> Decision {
    match &evidence.pilot {
        None => Decision::not_looked_for(),
        Some(pilot) => Decision::new(pilot.coverage.is_sparse(), pilot.coverage.to_string()),
    }
}

fn apply(draft: &mut Draft<'_>) {
    draft.settings.dropout = Some(Dropout {
        share: SHARE,
        // Any 32 bits of it do.
        seed: draft.settings.seed as u32,
    });
}
