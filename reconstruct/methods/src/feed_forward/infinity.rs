//! `infinity-homography`: both input views rotated into the orientation of the novel view, then blended by time,
//! as if everything were infinitely far.

use std::time::Instant;

use omnilife_schemas::RgbImage;

use omnilife_training::{
    error::ReconstructError,
    method::{
        Method, MethodKind, ON_CPU,
        group::{CameraPose, Group, GroupOutput},
    },
    request::DefaultPlan,
    stereo::warp::{mixed, turned},
};

/// Baseline that uses orientations, and no depth.
pub const METHOD: Method = Method {
    id: "infinity-homography",
    title: "Homography at infinity",
    source: "R. Hartley and A. Zisserman, Multiple View Geometry in Computer Vision, 13.4 (the \
             infinite homography; on the sphere a rotation)",
    description: "Baseline: both given views are turned into the orientation of the novel view \
                  (bilinear), as if everything were infinitely far, and blended by how near they \
                  are in time. Orientations are used, positions and depth are not.",
    components: &[],
    optional_components: &[],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU,
    requires: &[],
    options: &[],
    kind: MethodKind::FeedForward {
        settings: || serde_json::json!({}),
        interpolate,
    },
};

fn interpolate(group: &Group) -> Result<GroupOutput, ReconstructError> {
    let begun = Instant::now();
    let images = group
        .targets
        .iter()
        .map(|target| at_infinity(group, target))
        .collect();
    Ok(GroupOutput {
        images,
        gaussians: 0,
        analysis_seconds: 0.0,
        rendering_seconds: begun.elapsed().as_secs_f64(),
        warnings: Vec::new(),
    })
}

/// Returns the view from a target if everything were infinitely far.
pub(super) fn at_infinity(group: &Group, target: &CameraPose) -> RgbImage {
    let [first, second] = [0, 1].map(|index| {
        let view = &group.context[index];
        // From the target's camera frame to the input view's.
        let turn = view.camera_pose.to_world.transpose() * target.to_world;
        turned(&view.image, turn.as_mat3())
    });
    mixed(&first, &second, group.share_of_second(target))
}
