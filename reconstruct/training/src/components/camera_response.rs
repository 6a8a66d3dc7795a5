//! Component: the response of the camera is learnt with the Gaussians.

use omnilife_engine::{
    model::camera_response::{CAMERA_CURVE, CAMERA_GAINS},
    parameters::{decay::Decay, short_schedule::LearningRate},
    step::camera_response::ResponseSettings,
};

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::SceneEvidence,
};

/// Its name.
pub const ID: &str = "camera-response";

/// Response of the camera.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Response of the camera",
    description: "Renders are compared with images through a camera that is learnt with the Gaussians: a gain of each \
                  view and channel, one tone curve, and the vignette of a pinhole (after PPISP). Gains begin at those \
                  of exposure-compensation where that is used. Novel views get the gain of their time. Used on \
                  request alone, on the CPU.",
    turn: Turn::BeforePoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

/// Share of the schedule before the response changes: until then it would make up for what the scene lacks.
const BEGIN_SHARE: f64 = 0.1;
/// Sum of the steps of one number: a factor of e in light.
const REACH: f64 = 1.0;
/// Share of the first step sizes at the end, as in PPISP.
const END_SHARE: f32 = 0.01;
/// Step size of PPISP, the least one here. Its schedules have 30,000 steps.
const LEAST_RATE: f64 = 2e-3;
/// Largest step size: longer ones overshoot.
const LARGEST_RATE: f64 = 0.1;

fn decide(_: &SceneEvidence, _: &Draft<'_>) -> Decision {
    Decision::on_request("no scene was measured in which it pays")
}

fn apply(draft: &mut Draft<'_>) {
    let settings = &mut draft.settings;
    let steps = settings.iterations as f64 * (1.0 - BEGIN_SHARE);
    let views = draft.scene.input_views.len().max(1) as f64;
    // Steps take the gain of one view, and all other numbers.
    for (array, steps) in [(CAMERA_GAINS, steps / views), (CAMERA_CURVE, steps)] {
        let rate = LearningRate::unchanged(rate(steps));
        settings.learning_rates.insert(array.to_owned(), rate);
    }
    settings.response = Some(ResponseSettings {
        begin_iteration: (BEGIN_SHARE * settings.iterations as f64) as u64,
        learnt: None,
    });
}

/// Returns the rate of a number that takes so many steps.
fn rate(steps: f64) -> Decay {
    // Mean of a rate that falls log-linearly, over the first.
    let mean = f64::from((1.0 - END_SHARE) / -END_SHARE.ln());
    let begin = (REACH / (steps * mean)).clamp(LEAST_RATE, LARGEST_RATE) as f32;
    Decay {
        begin,
        end: END_SHARE * begin,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::aids;

    #[test]
    fn no_evidence_decides_on_it() {
        assert_eq!(aids::BY_NAME, [ID]);
    }

    #[test]
    fn numbers_reach_as_far_in_schedules_of_all_lengths() {
        // Sums over the schedule, at a hundred places of it.
        let reach = |steps: f64| {
            let rate = rate(steps);
            let places = (0..100).map(|place| f64::from(rate.at((place as f32 + 0.5) / 100.0)));
            steps * places.sum::<f64>() / 100.0
        };
        for steps in [100.0, 1_000.0, 2_000.0] {
            assert!((reach(steps) - 1.0).abs() < 0.01, "{}", reach(steps));
        }
        assert!(reach(10.0) < 0.3);
        let published = rate(30_000.0);
        assert!(published.begin == 2e-3 && published.end == 0.01 * 2e-3);
    }
}
