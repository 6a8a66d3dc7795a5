//! `sphere-sweep`: depth from two panoramas without learned weights, and views from it.
//!
//! ```text
//! for each view:  matching      cost of every pixel at every inverse distance (spherical sweep)
//!                 aggregate     semi-global smoothing, around the seam
//!                 depth         the best inverse distance, to a fraction of a step
//! consistency     the two depths against each other; what only one view sees is filled from behind
//! splats          one Gaussian per direction of an area-uniform sampling of the sphere
//! blend           both views' Gaussians rendered at the target, mixed by confidence and nearness
//! ```
//!
//! The plane sweep of Collins 1996 with spheres about a camera instead of planes; the published
//! feed-forward methods (PanSplat, Splatter-360, OmniSplat) learn what is fixed here: the matching
//! cost, its smoothing and the opacities.

mod aggregate;
mod blend;
mod consistency;
mod depth;
mod matching;
mod splats;

use std::time::Instant;

use glam::{DVec3, Mat3, Vec3};
use omnilife_schemas::RgbImage;
use serde::Serialize;

pub use depth::SweptDepth;

use crate::error::ReconstructError;
use crate::methods::feed_forward::{Group, Interpolated, infinity::at_infinity};
use crate::methods::{Method, MethodKind};

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
                  of an area-uniform sampling of the sphere; both are rendered at the novel view \
                  and blended by confidence and nearness.",
    components: &[],
    optional_components: &[],
    options: &[],
    kind: MethodKind::FeedForward {
        settings: || serde_json::json!(SweepSettings::DEFAULT),
        interpolate,
    },
};

/// What the sweep can be told.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SweepSettings {
    /// Width at which depth is searched, pixels; images that are narrower are searched at their own.
    pub search_width: usize,
    /// Parallax between two hypotheses on the search's equator, pixels.
    pub step_pixels: f32,
    /// Nearest distance that is searched, in distances between the two cameras.
    pub nearest_baselines: f32,
}

impl SweepSettings {
    /// The settings of the method.
    pub const DEFAULT: Self = Self {
        search_width: 512,
        step_pixels: 0.75,
        nearest_baselines: 1.25,
    };
}

/// Cameras closer together than this share of their distance from the world's origin, or than
/// anything that can be measured, see no parallax.
const SMALLEST_BASELINE: f64 = 1e-9;

/// The two views of a group in a frame in which f32 is enough: the origin is midway between the
/// cameras, the unit is their distance.
#[derive(Debug, Clone, Copy)]
pub struct Rig {
    /// Camera-to-rig rotations.
    pub to_rig: [Mat3; 2],
    /// Centres.
    pub centres: [Vec3; 2],
    /// World unit per rig unit: the distance of the cameras.
    pub baseline: f64,
    middle: DVec3,
}

impl Rig {
    /// `None` where the cameras stand in one place.
    pub fn new(group: &Group) -> Option<Self> {
        let camera_poses = [0, 1].map(|index| group.context[index].camera_pose);
        let [first, second] = camera_poses.map(|camera_pose| camera_pose.centre);
        let baseline = first.distance(second);
        let smallest = SMALLEST_BASELINE * first.length().max(second.length());
        if !(baseline > smallest && baseline.is_normal()) {
            return None;
        }
        let middle = 0.5 * (first + second);
        Some(Self {
            to_rig: camera_poses.map(|camera_pose| camera_pose.to_world.as_mat3()),
            centres: [first, second].map(|centre| ((centre - middle) / baseline).as_vec3()),
            baseline,
            middle,
        })
    }

    /// A point of the world in the rig's frame.
    pub fn place(&self, world: DVec3) -> Vec3 {
        ((world - self.middle) / self.baseline).as_vec3()
    }
}

/// Depth of both views of a group by sweeping each against the other. `None` where the cameras
/// stand in one place: there is no parallax to measure.
pub fn depths(group: &Group, settings: &SweepSettings) -> Option<(Rig, [SweptDepth; 2])> {
    let rig = Rig::new(group)?;
    let width = settings
        .search_width
        .min(group.camera.width as usize)
        .max(2);
    let height = (width * group.camera.height as usize / group.camera.width as usize).max(1);
    let images: [RgbImage; 2] =
        [0, 1].map(|index| group.context[index].image.resized_by_area(width, height));
    let hypotheses = matching::Hypotheses::new(width, settings);
    let search = |view: usize| {
        let other = 1 - view;
        // From this camera's frame to the other's, and where this centre is there.
        let turn = rig.to_rig[other].transpose() * rig.to_rig[view];
        let shift = rig.to_rig[other].transpose() * (rig.centres[view] - rig.centres[other]);
        let costs = matching::costs(&images[view], &images[other], turn, shift, &hypotheses);
        let sums = aggregate::aggregated(&costs, &images[view]);
        (depth::best(&sums, &hypotheses), turn, shift)
    };
    let (first, turn, shift) = search(0);
    let (second, back_turn, back_shift) = search(1);
    let step = hypotheses.step();
    let checked = [
        consistency::checked(&first, &second, turn, shift, step),
        consistency::checked(&second, &first, back_turn, back_shift, step),
    ];
    Some((rig, checked))
}

fn interpolate(group: &Group) -> Result<Interpolated, ReconstructError> {
    let begun = Instant::now();
    let Some((rig, depths)) = depths(group, &SweepSettings::DEFAULT) else {
        let images: Vec<RgbImage> = group
            .targets
            .iter()
            .map(|target| at_infinity(group, target))
            .collect();
        return Ok(Interpolated {
            images,
            gaussians: 0,
            analysis_seconds: 0.0,
            rendering_seconds: begun.elapsed().as_secs_f64(),
            remarks: vec![format!(
                "frames {} and {} were taken from one place: no depth, everything is at infinity",
                group.context[0].frame, group.context[1].frame
            )],
        });
    };
    let clouds =
        [0, 1].map(|view| splats::of_view(&group.context[view].image, &depths[view], &rig, view));
    let gaussians = clouds.iter().map(|cloud| cloud.len() as u64).sum();
    let analysis_seconds = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let images = blend::images(group, &rig, &clouds);
    Ok(Interpolated {
        images,
        gaussians,
        analysis_seconds,
        rendering_seconds: begun.elapsed().as_secs_f64(),
        remarks: Vec::new(),
    })
}
