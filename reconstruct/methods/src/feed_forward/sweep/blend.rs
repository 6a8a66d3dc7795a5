//! Views of two clouds of Gaussians, mixed.

use omnilife_schemas::RgbImage;
use rayon::prelude::*;

use crate::feed_forward::infinity::at_infinity;
use omnilife_engine::{
    camera::{Camera, View},
    gaussians::ActivatedGaussians,
    render::{cpu::Renderer, raster::Raster, settings::RenderSettings},
};
use omnilife_training::{
    method::group::{CameraPose, Group},
    stereo::Rig,
};

/// Minimum distance of visible Gaussians, in distances between the cameras.
const NEAR: f32 = 0.01;
/// Weight of a view's render beside its confidence, so that the better of two unconfirmed views is still visible.
const LEAST_WEIGHT: f32 = 1e-3;
/// Weight of the far background where both views are empty.
const BACKGROUND_WEIGHT: f32 = 1e-4;

/// Returns one image per target of the group.
pub(super) fn images(group: &Group, rig: &Rig, clouds: &[ActivatedGaussians; 2]) -> Vec<RgbImage> {
    let mut renderers = [0, 1].map(|_| Renderer::new(RenderSettings::new(NEAR)));
    group
        .targets
        .iter()
        .map(|target| {
            let view = View {
                camera: Camera::Erp(group.camera),
                rotation: target.to_world.transpose().as_mat3(),
                centre: rig.place(target.centre),
                time_seconds: target.time_seconds,
            };
            let [first, second] = &mut renderers;
            let drawn = [
                first.forward(&view, &clouds[0]),
                second.forward(&view, &clouds[1]),
            ];
            mixed(group, rig, target, drawn)
        })
        .collect()
}

/// Mixes colours by confidence and by the target's proximity to their view, in space and in time.
fn mixed(group: &Group, rig: &Rig, target: &CameraPose, drawn: [&Raster; 2]) -> RgbImage {
    let background = at_infinity(group, target);
    let place = rig.place(target.centre);
    let [to_first, to_second] = rig.centres.map(|centre| centre.distance(place));
    let of_second = 0.5 * (to_first / (to_first + to_second) + group.share_of_second(target));
    let shares = [1.0 - of_second, of_second];
    let mut image = background;
    image
        .data
        .as_chunks_mut::<3>()
        .0
        .par_iter_mut()
        .enumerate()
        .with_min_len(4096)
        .for_each(|(pixel, colour)| {
            let mut sum = colour.map(|value| value * BACKGROUND_WEIGHT);
            let mut total = BACKGROUND_WEIGHT;
            for (raster, share) in drawn.iter().zip(shares) {
                let opacity = 1.0 - raster.transmittance[pixel];
                if opacity < 0.05 {
                    continue;
                }
                let weight = share * (raster.features[pixel] + LEAST_WEIGHT * opacity);
                for (sum, value) in sum.iter_mut().zip(&raster.colour[pixel * 3..]) {
                    *sum += weight * value / opacity;
                }
                total += weight;
            }
            *colour = sum.map(|value| (value / total).clamp(0.0, 1.0));
        });
    image
}
