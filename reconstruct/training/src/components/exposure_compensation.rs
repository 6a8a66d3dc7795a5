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
    description: "Takes the gains of a camera's automatic exposure out of the light of the images before they are \
                  compared with renders, and puts the gain of the frame's time back onto the renders. What is \
                  saturated holds them to being as bright at least, and to no level. Used where \
                  gains deviate and the parts of an image agree on them.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| request.allows(ID),
    decide,
    apply,
};

fn decide(evidence: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    match evidence.pilot.as_ref().map(|pilot| &pilot.exposure) {
        None => Decision::not_looked_for(),
        Some(None) => Decision::without("enough of the images that can be compared"),
        Some(Some(found)) => {
            let reason = format!(
                "{found}; {:.2} % of the pixels are saturated: with gains taken out they hold a render to no more \
                 than being as bright",
                100.0 * draft.scene.saturated_share()
            );
            Decision::new(found.is_worth_compensating(), reason)
        }
    }
}

fn apply(draft: &mut Draft<'_>) {
    let pilot = draft.evidence.pilot.as_ref();
    let found = pilot.and_then(|pilot| pilot.exposure.as_ref());
    draft.settings.exposure = found.map(|found| found.gains.clone());
}
