//! `sphere-sweep`: depth from two panoramas without learned weights, and views from it.
//!
//! ```text
//! stereo          depth of both views (see [`omnilife_training::stereo`])
//! splats          one Gaussian per direction of an area-uniform sampling of the sphere
//! blend           both views' Gaussians rendered at the target, for distance and confidence there
//! cubic           colours of both views at that distance, mixed by confidence, agreement and nearness
//! ```
//!
//! The published feed-forward methods (PanSplat, Splatter-360, OmniSplat) train the parts that are fixed here:
//! the matching cost, its smoothing and the opacities.

mod blend;
mod cubic;
mod splats;

use std::time::Instant;

use omnilife_schemas::RgbImage;

use crate::feed_forward::infinity::at_infinity;
use omnilife_training::{
    error::ReconstructError,
    method::{
        Method, MethodKind, ON_CPU,
        group::{Group, GroupOutput},
    },
    request::DefaultPlan,
    stereo::{self, Placement, Rig, SweepSettings, SweptDepth},
};

/// Feed-forward, without learned weights.
pub const METHOD: Method = Method {
    id: "sphere-sweep",
    title: "Spherical plane sweep",
    source: "this project; after R. T. Collins, A Space-Sweep Approach to True Multi-Image \
             Matching, CVPR 1996, and H. Hirschmueller, Stereo Processing by Semiglobal Matching \
             and Mutual Information, PAMI 2008",
    description: "Feed-forward, nothing is learned: a spherical plane sweep between the two given \
                  views (colour and census, semi-global aggregation around the seam, left-right \
                  check) gives depth and confidence; each view becomes one Gaussian per direction \
                  of an area-uniform sampling of the sphere; both are rendered at the novel view; \
                  the distances there lead back to sharp colours of both input views (cubic), \
                  which are blended by confidence, agreement and nearness.",
    components: &[],
    optional_components: &[],
    ablation: &[],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU,
    requires: &[],
    options: &[],
    kind: MethodKind::FeedForward {
        settings: || serde_json::json!(SweepSettings::DEFAULT),
        interpolate,
    },
};

/// Returns the depth of both views of a group. `None` where the cameras stand in one place.
pub fn depths(group: &Group, settings: &SweepSettings) -> Option<(Rig, [SweptDepth; 2])> {
    let cameras = [0, 1].map(|index: usize| {
        let pose = group.context[index].camera_pose;
        Placement {
            to_world: pose.to_world,
            centre: pose.centre,
        }
    });
    let images = [&group.context[0].image, &group.context[1].image];
    stereo::depths(images, cameras, settings)
}

fn interpolate(group: &Group) -> Result<GroupOutput, ReconstructError> {
    let begun = Instant::now();
    let Some((rig, depths)) = depths(group, &SweepSettings::DEFAULT) else {
        let images: Vec<RgbImage> = group
            .targets
            .iter()
            .map(|target| at_infinity(group, target))
            .collect();
        return Ok(GroupOutput {
            images,
            gaussians: 0,
            analysis_seconds: 0.0,
            rendering_seconds: begun.elapsed().as_secs_f64(),
            warnings: vec![format!(
                "frames {} and {} were taken from one place: no depth, everything is at infinity",
                group.context[0].frame, group.context[1].frame
            )],
        });
    };
    let mut clouds =
        [0, 1].map(|view| splats::of_view(&group.context[view].image, &depths[view], &rig, view));
    let gaussians = clouds.iter().map(|cloud| cloud.len() as u64).sum();
    let analysis_seconds = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let images = blend::images(group, &rig, &mut clouds);
    Ok(GroupOutput {
        images,
        gaussians,
        analysis_seconds,
        rendering_seconds: begun.elapsed().as_secs_f64(),
        warnings: Vec::new(),
    })
}
