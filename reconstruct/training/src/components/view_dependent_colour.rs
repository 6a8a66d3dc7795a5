//! Component: colours depend on the viewing direction.

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::{SceneEvidence, view_dependence::SH_DEGREE},
};

/// Its name.
pub const ID: &str = "view-dependent-colour";

/// View-dependent colour.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "View-dependent colour",
    description: "Colours are spherical harmonics of degree 1. Used where the colours of flat surfaces \
                  change with the direction; a degree that is asked for goes before that.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| {
        request.options.sh_degree().is_none() && request.leaves_to_evidence(ID)
    },
    decide,
    apply,
};

fn decide(evidence: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    if let Some(degree) = draft.request.options.sh_degree() {
        let reason = format!("spherical harmonics of degree {degree} on request");
        return Decision::new(degree > 0, reason).settled();
    }
    match &evidence.pilot {
        None => Decision::not_looked_for(),
        Some(pilot) => {
            let found = &pilot.view_dependence;
            Decision::new(found.is_worth_harmonics(), found.to_string())
        }
    }
}

fn apply(draft: &mut Draft<'_>) {
    draft.settings.rendering.sh_degree = draft.request.options.sh_degree().unwrap_or(SH_DEGREE);
}
