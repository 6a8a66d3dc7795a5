//! Component: images are compared at one exposure.

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "exposure-compensation";

/// Exposure compensation.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Exposure compensation",
    description: "Takes the gains of a camera's automatic exposure out of the images before they are \
                  compared with renders, and puts the gain of the frame_time back onto the renders. Used \
                  where the gains of the views deviate.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| request.allows(ID),
    decide,
    apply,
};

fn decide(evidence: &SceneEvidence, _: &Draft<'_>) -> Decision {
    match evidence.pilot.as_ref().map(|pilot| &pilot.exposure) {
        None => Decision::not_looked_for(),
        Some(None) => Decision::without("enough scene points that are seen"),
        Some(Some(found)) => Decision::new(found.drifts(), found.text()),
    }
}

fn apply(draft: &mut Draft<'_>) {
    let pilot = draft.evidence.pilot.as_ref();
    draft.settings.exposure = pilot.and_then(|pilot| pilot.exposure.clone());
}
