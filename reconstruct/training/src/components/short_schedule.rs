//! Component: larger steps in schedules shorter than the published one.

use omnilife_engine::step::settings::TrainSettings;

use crate::{
    baseline::{PUBLISHED_ITERATIONS, SHORT_SCHEDULE},
    components::{Component, Decision, DecisionLog, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "short-schedule";

/// Larger steps in short schedules.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Steps of a short schedule",
    description: "Step sizes that grow with the square root of how much shorter the schedule is than \
                  the published one, and fall towards its end, by exponents that every array of \
                  parameters states. Used where it is shorter, or where a time budget may end it \
                  early, whatever the plan; --without short-schedule has the published rates.",
    turn: Turn::BeforePoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

/// Decides on it for a run that is not drafted, and applies it if it is used.
pub fn decide_for(settings: &mut TrainSettings, plan: &mut DecisionLog<'_>) {
    if plan.decide(ID, decision(settings)) {
        settings.short_schedule = Some(SHORT_SCHEDULE);
    }
}

fn decide(_: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    decision(&draft.settings)
}

fn decision(settings: &TrainSettings) -> Decision {
    let iterations = settings.iterations;
    let factor = SHORT_SCHEDULE.factor(iterations as f64);
    let is_short = factor > 1.0;
    let has_budget = settings.budget_seconds.is_some();
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
