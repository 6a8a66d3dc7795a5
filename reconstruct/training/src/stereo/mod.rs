//! Depth from two panoramas without learned weights: the plane sweep of Collins 1996 with spheres about
//! a camera instead of planes.
//!
//! ```text
//! for each view:  matching      cost of every pixel at every inverse distance (spherical sweep)
//!                 aggregate     semi-global smoothing, around the seam
//!                 depth         the best inverse distance, to a fraction of a step
//! consistency     the two depths against each other; what only one view sees is filled from behind
//! ```

mod consistency;
mod depth;
mod matching;
pub mod warp;

use glam::{DMat3, DVec3, Mat3, Vec3};
use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::RgbImage;
use omnilife_stereo::RowEnds;
use serde::Serialize;

pub use depth::SweptDepth;

/// Settings of the sweep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SweepSettings {
    /// Width of the search for depth, pixels; narrower images are searched at their own.
    pub search_width: usize,
    /// Parallax between two hypotheses on the search's equator, pixels.
    pub step_pixels: f32,
    /// Minimum distance of the search, in distances between the two cameras.
    pub nearest_baselines: f32,
}

impl SweepSettings {
    /// The settings of `sphere-sweep`.
    pub const DEFAULT: Self = Self {
        search_width: 512,
        step_pixels: 0.75,
        nearest_baselines: 1.25,
    };
}

/// Minimum ratio of the cameras' distance to their distance from the world's origin: closer cameras have no
/// measurable parallax.
const SMALLEST_BASELINE: f64 = 1e-9;

/// Orientation and position of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Camera-to-world rotation.
    pub to_world: DMat3,
    /// Centre in units of the world.
    pub centre: DVec3,
}

/// Two views in a frame in which f32 is enough: the origin is midway between the cameras, the unit is
/// their distance.
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
    /// Returns `None` if the cameras stand in one place.
    pub fn new(cameras: [Placement; 2]) -> Option<Self> {
        let [first, second] = cameras.map(|camera| camera.centre);
        let baseline = first.distance(second);
        let smallest = SMALLEST_BASELINE * first.length().max(second.length());
        if !(baseline > smallest && baseline.is_normal()) {
            return None;
        }
        let middle = 0.5 * (first + second);
        Some(Self {
            to_rig: cameras.map(|camera| camera.to_world.as_mat3()),
            centres: [first, second].map(|centre| ((centre - middle) / baseline).as_vec3()),
            baseline,
            middle,
        })
    }

    /// Returns a point of the world in the rig's frame.
    pub fn place(&self, world: DVec3) -> Vec3 {
        ((world - self.middle) / self.baseline).as_vec3()
    }
}

/// Returns a view's image of a size (width, height) for the search, in which ignored pixels are unknown: matches with
/// them cost the most, whatever they show.
pub fn searched_image(view: &TrainingView, [width, height]: [usize; 2]) -> RgbImage {
    let mut image = RgbImage::from_rgb8(width, height, &view.pixels);
    if view.ignored.is_some() {
        let pixels = image.data.as_chunks_mut::<3>().0.iter_mut().enumerate();
        for (_, colour) in pixels.filter(|&(pixel, _)| !view.shows_scene(pixel)) {
            *colour = [f32::NAN; 3];
        }
    }
    image
}

/// Estimates the depth of two panoramas of one size by sweeping each against the other. `None` if the cameras
/// stand in one place: there is no parallax to measure.
pub fn depths(
    images: [&RgbImage; 2],
    cameras: [Placement; 2],
    settings: &SweepSettings,
) -> Option<(Rig, [SweptDepth; 2])> {
    let rig = Rig::new(cameras)?;
    let size = images[0];
    let width = settings.search_width.min(size.width).max(2);
    let height = (width * size.height / size.width).max(1);
    let images: [RgbImage; 2] = images.map(|image| image.resized_by_area(width, height));
    let hypotheses = matching::Hypotheses::new(width, settings);
    let search = |view: usize| {
        let other = 1 - view;
        // From this camera's frame to the other's, and this centre in it.
        let turn = rig.to_rig[other].transpose() * rig.to_rig[view];
        let shift = rig.to_rig[other].transpose() * (rig.centres[view] - rig.centres[other]);
        let costs = matching::costs(&images[view], &images[other], turn, shift, &hypotheses);
        let sums = omnilife_stereo::aggregated(
            &costs,
            images[view].data.as_chunks::<3>().0,
            RowEnds::Joined,
        );
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
