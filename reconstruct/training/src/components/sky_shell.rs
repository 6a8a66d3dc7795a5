//! Component: a shell of Gaussians in the directions without points.

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
    seeds::sky::{OpenSky, SKY_SHARE},
};

/// Its name.
pub const ID: &str = "sky-shell";

/// Sky shell.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Sky shell",
    description: "Adds a shell of static Gaussians around the scene in the directions in which it has \
                  no points. Used where enough of the sphere is open, whatever the plan.",
    turn: Turn::BeforePoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

fn decide(_: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    let sky = OpenSky::of(draft.scene, draft.room());
    let reason = format!(
        "{:.1} % of {} directions have no point (limit {:.0} %)",
        100.0 * sky.share(),
        sky.seen,
        100.0 * SKY_SHARE
    );
    Decision::new(sky.is_worth_a_shell(), reason).whatever_the_plan()
}

fn apply(draft: &mut Draft<'_>) {
    let sky = OpenSky::of(draft.scene, draft.room());
    draft.fixed = sky.shell(draft.scene, draft.settings.exposure.as_ref());
}
