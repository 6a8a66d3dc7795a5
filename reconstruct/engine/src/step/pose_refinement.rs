//! Refinement of the pose of the view that a step draws.

use serde::{Deserialize, Serialize};

use crate::{
    camera::View,
    gaussians::ActivatedGaussians,
    render::project::by_camera::{self, PoseGradient},
};
use crate::{model::Model, schedule::StepSchedule, step::StepStatistics};

/// Schedule of pose refinement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseRefinement {
    /// First iteration of the schedule that refines poses.
    pub begin_iteration: u64,
}

impl PoseRefinement {
    /// Returns the gradient by the pose of the view that a step drew, if the step refines it.
    pub(super) fn gradient(
        settings: Option<Self>,
        schedule: &StepSchedule,
        drawn: &View,
        gaussians: &ActivatedGaussians,
        by_gaussians: &ActivatedGaussians,
    ) -> Option<PoseGradient> {
        let takes_part = schedule.scheduled >= settings?.begin_iteration;
        takes_part.then(|| by_camera::gradient(drawn, gaussians, schedule.sh_degree, by_gaussians))
    }
}

/// Updates the pose of input view number `view`.
pub(super) fn move_pose(
    model: &mut Model,
    view: usize,
    gradient: Option<&PoseGradient>,
    schedule: &StepSchedule,
    statistics: &mut StepStatistics,
) {
    let (Some(poses), Some(gradient)) = (&mut model.poses, gradient) else {
        return;
    };
    // Its arrays are the last ones of the model.
    let [.., of_rotation, of_centre] = schedule.learning_rates[..] else {
        return;
    };
    let refused = poses.step(view, gradient, [of_rotation, of_centre]);
    let first = schedule.learning_rates.len() - refused.len();
    for (sum, refused) in statistics.refused[first..].iter_mut().zip(refused) {
        *sum += refused as u64;
    }
}
