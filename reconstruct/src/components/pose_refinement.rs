//! Component: the input views' poses are refined with the Gaussians.

use crate::components::Components;
use crate::{evidence::poses::PoseEvidence, scene::TrainingScene};
use omnilife_engine::{
    model::pose_corrections::{CAMERA_CENTRES, CAMERA_ROTATIONS},
    parameters::decay::Decay,
    step::{pose_refinement::PoseRefinement, settings::TrainSettings},
};

/// Component: the poses of the input views are refined.
pub(crate) const POSE_REFINEMENT: &str = "pose-refinement";

/// Share of the schedule before poses move: until then there is little of a scene to hold them
/// against.
const BEGIN_SHARE: f64 = 0.05;
/// The step sizes of a view's rotation add up to this many times the displacement that was found, over
/// all of its steps: in a schedule of 30,000 iterations on 50 views to about 1e-4 radians each at
/// first, the 1e-4 of nerfstudio's splatfacto (the trainer of gsplat's examples has 1e-5, BARF and
/// nerfacto 1e-3).
const REACH: f64 = 2.0;
/// Step sizes fall to this share of the first ones.
const END_SHARE: f32 = 0.1;
/// A rate has a logarithm.
const LEAST_RATE: f64 = 1e-9;
/// Fewer steps than this would have to be too long.
const LEAST_STEPS: f64 = 6.0;

/// Decides by how far the poses are off whether they are refined.
pub(crate) fn decide(evidence: &PoseEvidence, components: &mut Components<'_>) -> bool {
    let missing = (evidence.views == 0).then_some("enough scene points that are seen");
    let by_evidence = (evidence.are_off(), evidence.text());
    components.decide_with(POSE_REFINEMENT, missing, by_evidence)
}

/// Lets training refine poses that are off as the evidence says.
pub(crate) fn add(settings: &mut TrainSettings, scene: &TrainingScene, evidence: &PoseEvidence) {
    let views = scene.input_views.len().max(1) as f64;
    let steps = (settings.iterations as f64 * (1.0 - BEGIN_SHARE) / views).max(LEAST_STEPS);
    // The mean of a rate that falls log-linearly, over the first.
    let mean = f64::from((1.0 - END_SHARE) / -END_SHARE.ln());
    let rate = (REACH * evidence.shift_radians / (steps * mean)).max(LEAST_RATE) as f32;
    let distance = evidence.distance as f32;
    for (array, begin) in [(CAMERA_ROTATIONS, rate), (CAMERA_CENTRES, rate * distance)] {
        let end = END_SHARE * begin;
        let decay = Decay { begin, end };
        settings.learning_rates.insert(array.to_owned(), decay);
    }
    settings.pose_refinement = Some(PoseRefinement {
        begin_iteration: (BEGIN_SHARE * settings.iterations as f64) as u64,
    });
}
