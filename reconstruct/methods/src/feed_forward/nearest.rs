//! `nearest-input`: the input view that is nearest in time, unchanged.

use std::time::Instant;

use omnilife_training::{
    error::ReconstructError,
    method::{
        Method, MethodKind, ON_CPU,
        group::{Group, GroupOutput},
    },
    request::DefaultPlan,
};

/// Baseline without any computation.
pub const METHOD: Method = Method {
    id: "nearest-input",
    title: "Nearest input view",
    source: "baseline of this project",
    description: "Baseline: every novel view is the given view nearest in time, unchanged (the \
                  earlier one of two as near). No pose is used.",
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
        .map(|target| {
            let nearest = usize::from(group.share_of_second(target) > 0.5);
            group.context[nearest].image.clone()
        })
        .collect();
    Ok(GroupOutput {
        images,
        gaussians: 0,
        analysis_seconds: 0.0,
        rendering_seconds: begun.elapsed().as_secs_f64(),
        warnings: Vec::new(),
    })
}
