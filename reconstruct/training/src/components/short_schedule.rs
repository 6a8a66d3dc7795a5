//! Component: larger steps in schedules shorter than the published one.

use crate::{
    baseline::{PUBLISHED_ITERATIONS, SHORT_SCHEDULE},
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "short-schedule";

/// Larger steps in short schedules.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Steps of a short schedule",
    description: "Step sizes of positions, sizes, rotations, opacities, colours, velocities and peak \
                  times that grow with the square root of how much shorter the schedule is than the \
                  published one, and fall towards its end. Used where it is shorter, or where a time budget may end it early, \
                  whatever the plan.",
    turn: Turn::BeforePoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

fn decide(_: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    let iterations = draft.settings.iterations;
    let factor = SHORT_SCHEDULE.factor(iterations as f64);
    let is_short = factor > 1.0;
    let has_budget = draft.settings.budget_seconds.is_some();
    let reason = if has_budget {
        "steps as large as the number of iterations asks for that the time budget leaves room for"
            .to_owned()
    } else {
        format!(
            "{iterations} iterations where rates are made for {PUBLISHED_ITERATIONS}: steps \
             {factor:.1} times as large"
        )
    };
    Decision::new(is_short || has_budget, reason).whatever_the_plan()
}

fn apply(draft: &mut Draft<'_>) {
    draft.settings.short_schedule = Some(SHORT_SCHEDULE);
}
