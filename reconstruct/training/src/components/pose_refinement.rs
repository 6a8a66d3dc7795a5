//! Component: the input views' poses are refined with the Gaussians.

use crate::{
    components::{Component, Decision, Draft, Turn},
    evidence::{SceneEvidence, poses::PoseEvidence},
};
use omnilife_engine::{
    model::pose_corrections::{CAMERA_CENTRES, CAMERA_ROTATIONS},
    parameters::{decay::Decay, short_schedule::LearningRate},
    step::{pose_refinement::PoseRefinement, settings::TrainSettings},
};

/// Its name.
pub const ID: &str = "pose-refinement";

/// Pose refinement.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Pose refinement",
    description: "The poses of the input views move with the Gaussians, by the exact gradient; novel \
                  views get what their neighbours in time say. Used where the poses are off by more \
                  than chance explains.",
    turn: Turn::BeforePoints,
    needs_pilot: |request, _| request.allows(ID),
    decide,
    apply,
};

/// Share of the schedule before poses move: until then the scene is too coarse for comparison.
const BEGIN_SHARE: f64 = 0.05;
/// Sum of a view's rotation steps, in multiples of the measured displacement. In a schedule of 30,000 iterations
/// on 50 views that is about 1e-4 radians per step at first, the 1e-4 of nerfstudio's splatfacto. The trainer of
/// gsplat's examples has 1e-5, BARF and nerfacto 1e-3.
const REACH: f64 = 2.0;
/// Share of the first step sizes at the end.
const END_SHARE: f32 = 0.1;
/// Minimum rate, for its logarithm.
const LEAST_RATE: f64 = 1e-9;
/// Minimum number of steps: fewer would have to be too long.
const LEAST_STEPS: f64 = 6.0;

fn decide(evidence: &SceneEvidence, _: &Draft<'_>) -> Decision {
    let Some(pilot) = &evidence.pilot else {
        return Decision::not_looked_for();
    };
    let missing = (pilot.poses.views == 0).then_some("enough scene points that are seen");
    Decision::new(pilot.poses.are_off(), pilot.poses.to_string()).unless(missing)
}

fn apply(draft: &mut Draft<'_>) {
    let views = draft.scene.input_views.len();
    if let Some(pilot) = &draft.evidence.pilot {
        refine(&mut draft.settings, views, &pilot.poses);
    }
}

/// Lets training refine poses by the measured error.
fn refine(settings: &mut TrainSettings, views: usize, evidence: &PoseEvidence) {
    let views = views.max(1) as f64;
    let steps = (settings.iterations as f64 * (1.0 - BEGIN_SHARE) / views).max(LEAST_STEPS);
    // Mean of a rate that falls log-linearly, over the first.
    let mean = f64::from((1.0 - END_SHARE) / -END_SHARE.ln());
    let rate = (REACH * evidence.shift_radians / (steps * mean)).max(LEAST_RATE) as f32;
    let distance = evidence.distance as f32;
    for (array, begin) in [(CAMERA_ROTATIONS, rate), (CAMERA_CENTRES, rate * distance)] {
        let end = END_SHARE * begin;
        // The rate is by the number of steps of this schedule already.
        let rate = LearningRate::unchanged(Decay { begin, end });
        settings.learning_rates.insert(array.to_owned(), rate);
    }
    settings.pose_refinement = Some(PoseRefinement {
        begin_iteration: (BEGIN_SHARE * settings.iterations as f64) as u64,
    });
}
