//! `cross-fade`: the two input views blended by time.

use std::time::Instant;

use omnilife_training::{
    error::ReconstructError,
    method::{
        Method, MethodKind, ON_CPU,
        group::{Group, GroupOutput},
    },
    request::DefaultPlan,
    stereo::warp::mixed,
};

/// Baseline that uses the time only.
pub const METHOD: Method = Method {
    id: "cross-fade",
    title: "Cross-fade",
    source: "baseline of this project",
    description: "Baseline: every novel view is the mean of the two given views, weighted by how \
                  near they are in time. No pose is used.",
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
    let [first, second] = [0, 1].map(|index| &group.context[index].image);
    let images = group
        .targets
        .iter()
        .map(|target| mixed(first, second, group.share_of_second(target)))
        .collect();
    Ok(GroupOutput {
        images,
        gaussians: 0,
        analysis_seconds: 0.0,
        rendering_seconds: begun.elapsed().as_secs_f64(),
        warnings: Vec::new(),
    })
}
