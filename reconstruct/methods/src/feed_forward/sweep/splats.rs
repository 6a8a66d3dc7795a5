//! Conversion of a view with depth to Gaussians.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, vec3};
use omnilife_schemas::RgbImage;
use rayon::prelude::*;

use omnilife_engine::gaussians::ActivatedGaussians;
use omnilife_training::stereo::{
    Rig, SweptDepth,
    warp::{bilinear, sample},
};

/// Distance that counts as infinitely far, in distances between the cameras.
const FARTHEST: f32 = 2000.0;
/// Minimum distance of a Gaussian in its inverse distance, in distances between the cameras.
const NEAREST: f32 = 1e-3;
/// Standard deviation of a Gaussian in pixels of the image's equator.
const SIZE_PIXELS: f32 = 0.35;
/// Opacity of every Gaussian.
const OPACITY: f32 = 0.9;
/// Confidence of directions that the other view does not confirm: they are visible where no better Gaussian is.
const LEAST_CONFIDENCE: f32 = 0.1;
/// Differences of colour (summed over channels, [0, 1]) between a direction and a pixel of the depth map beyond
/// which they belong to different surfaces.
const COLOUR_SCALE: f32 = 0.08;

/// Makes one Gaussian per direction of an area-uniform sampling of the sphere. Every row of the image gets as
/// many as its circle is long, `W cos(latitude)`, so that density is even and the poles are not crowded. Feature
/// 0 is the confidence, feature 1 is 0 until [`set_inverse_distances`]. Colours are left grey: they are looked up in
/// the image.
pub(super) fn of_view(
    image: &RgbImage,
    depth: &SweptDepth,
    rig: &Rig,
    view: usize,
) -> ActivatedGaussians {
    let (width, height) = (image.width as f32, image.height as f32);
    let small = image.resized_by_area(depth.width, depth.height);
    let rows: Vec<Vec<SampledPixel>> = (0..image.height)
        .into_par_iter()
        .map(|row| {
            let latitude = (0.5 - (row as f32 + 0.5) / height) * PI;
            let count = (width * latitude.cos()).round().max(1.0) as usize;
            (0..count)
                .map(|index| {
                    let share = (index as f32 + 0.5) / count as f32;
                    let longitude = (share - 0.5) * TAU;
                    let colour = sample(image, [share * width, row as f32 + 0.5]);
                    let place = [
                        share * depth.width as f32,
                        (row as f32 + 0.5) / height * depth.height as f32,
                    ];
                    let (inverse, confidence) = looked_up(depth, &small, place, colour);
                    let direction = vec3(
                        latitude.cos() * longitude.sin(),
                        -latitude.sin(),
                        latitude.cos() * longitude.cos(),
                    );
                    let distance = 1.0 / inverse.max(1.0 / FARTHEST);
                    SampledPixel {
                        position: rig.centres[view] + distance * (rig.to_rig[view] * direction),
                        scale: SIZE_PIXELS * distance * PI / height,
                        confidence: confidence.max(LEAST_CONFIDENCE),
                    }
                })
                .collect()
        })
        .collect();
    let samples: Vec<SampledPixel> = rows.into_iter().flatten().collect();
    ActivatedGaussians {
        positions: samples.iter().map(|s| s.position.to_array()).collect(),
        scales: samples.iter().map(|s| [s.scale; 3]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; samples.len()],
        opacities: vec![OPACITY; samples.len()],
        sh_constant: vec![[0.0; 3]; samples.len()],
        sh_degree: 0,
        sh_rest: Vec::new(),
        feature_count: 2,
        features: samples.iter().flat_map(|s| [s.confidence, 0.0]).collect(),
    }
}

/// Sets feature 1 of every Gaussian to its inverse distance from a place, in the rig's units.
pub(super) fn set_inverse_distances(cloud: &mut ActivatedGaussians, place: Vec3) {
    let positions = cloud.positions.par_iter();
    let features = cloud.features.as_chunks_mut::<2>().0.par_iter_mut();
    features
        .zip(positions)
        .with_min_len(4096)
        .for_each(|(features, &position)| {
            features[1] = 1.0 / Vec3::from_array(position).distance(place).max(NEAREST);
        });
}

struct SampledPixel {
    position: Vec3,
    scale: f32,
    confidence: f32,
}

/// Returns inverse distance and confidence of a direction, from the similar ones among the four pixels of the
/// depth map around it. A mean across an edge of depth would float in the air.
fn looked_up(
    depth: &SweptDepth,
    small: &RgbImage,
    place: [f32; 2],
    colour: [f32; 3],
) -> (f32, f32) {
    let mut best = (0.0, 0.0, 0.0);
    for (pixel, weight) in bilinear(depth.width, depth.height, place) {
        let difference: f32 = small.data[pixel * 3..pixel * 3 + 3]
            .iter()
            .zip(colour)
            .map(|(a, b)| (a - b).abs())
            .sum();
        let weight = (weight + 1e-3) * (-difference / COLOUR_SCALE).exp().max(1e-6);
        if weight > best.0 {
            best = (
                weight,
                depth.inverse_distances[pixel],
                depth.confidences[pixel],
            );
        }
    }
    (best.1, best.2)
}
