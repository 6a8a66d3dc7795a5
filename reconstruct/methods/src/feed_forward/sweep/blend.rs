//! Novel views: colours of the two input views, mixed.
//!
//! The clouds of Gaussians render the distance `D` of both views' surfaces at a novel view. A pixel with the ray `r`
//! at the centre `c` shows the colour of input view `k` in the direction `r + (c - c_k) / D`. Both input views are looked
//! up at either distance: where they agree on a colour, the distance is right.

use glam::Vec3;
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
    stereo::{
        Rig,
        warp::{ErpRays, erp_pixel},
    },
};

use super::{cubic, splats::set_inverse_distances};

/// Minimum distance of visible Gaussians, in distances between the cameras.
const NEAR: f32 = 0.01;
/// Mean difference of the two views' channels at which the weight of their distance has fallen to 1/e, in [0, 1].
const AGREEMENT_SCALE: f32 = 0.03;
/// Weight of a distance beside its confidence, so that the better of two refuted ones is still visible.
const LEAST_WEIGHT: f32 = 1e-4;
/// Weight of the far background where both views are empty.
const BACKGROUND_WEIGHT: f32 = 1e-6;

/// Returns one image per target of the group. Feature 1 of the clouds is overwritten.
pub(super) fn images(
    group: &Group,
    rig: &Rig,
    clouds: &mut [ActivatedGaussians; 2],
) -> Vec<RgbImage> {
    let rays = ErpRays::new(group.camera.width as usize, group.camera.height as usize);
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
            for cloud in &mut *clouds {
                set_inverse_distances(cloud, view.centre);
            }
            let [first, second] = &mut renderers;
            let drawn = [
                first.forward(&view, &clouds[0]),
                second.forward(&view, &clouds[1]),
            ];
            mixed(group, rig, &rays, target, drawn)
        })
        .collect()
}

/// Mixes colours by confidence, agreement, and the target's proximity to their view, in space and in time.
fn mixed(
    group: &Group,
    rig: &Rig,
    rays: &ErpRays,
    target: &CameraPose,
    drawn: [&Raster; 2],
) -> RgbImage {
    let background = at_infinity(group, target);
    let place = rig.place(target.centre);
    let [to_first, to_second] = rig.centres.map(|centre| centre.distance(place));
    let of_second = 0.5 * (to_first / (to_first + to_second) + group.share_of_second(target));
    let shares = [1.0 - of_second, of_second];
    let to_rig = target.to_world.as_mat3();
    let (width, pixels) = (background.width, background.width * background.height);
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
            let ray = to_rig * rays.ray(pixel % width, pixel / width);
            for (raster, share) in drawn.iter().zip(shares) {
                let opacity = 1.0 - raster.transmittance[pixel];
                if opacity < 0.05 {
                    continue;
                }
                let confidence = raster.features[pixel] / opacity;
                let inverse_distance = raster.features[pixels + pixel] / opacity;
                let colours = [0, 1].map(|view| {
                    let direction = ray + inverse_distance * (place - rig.centres[view]);
                    looked_up(group, rig, view, direction)
                });
                let weight = share * (confidence * agreement(colours) + LEAST_WEIGHT);
                for (channel, sum) in sum.iter_mut().enumerate() {
                    let [first, second] = colours.map(|colour| colour[channel]);
                    *sum += weight * (shares[0] * first + shares[1] * second);
                }
                total += weight;
            }
            *colour = sum.map(|value| (value / total).clamp(0.0, 1.0));
        });
    image
}

/// Returns 1 for two equal colours, and less the more they differ.
fn agreement([first, second]: [[f32; 3]; 2]) -> f32 {
    let difference: f32 = first.iter().zip(second).map(|(a, b)| (a - b).abs()).sum();
    (-difference / (3.0 * AGREEMENT_SCALE)).exp()
}

/// Returns the colour of an input view in a direction of the rig's frame.
fn looked_up(group: &Group, rig: &Rig, view: usize, direction: Vec3) -> [f32; 3] {
    let image = &group.context[view].image;
    let seen = rig.to_rig[view].transpose() * direction;
    cubic::sample(
        image,
        erp_pixel(seen, image.width as f32, image.height as f32),
    )
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]
mod tests {
    use glam::{DMat3, DVec3, dvec3};
    use omnilife_schemas::camera::ErpCamera;
    use omnilife_training::{
        method::group::ContextView,
        stereo::{Placement, SweptDepth},
    };

    use super::*;
    use crate::feed_forward::sweep::splats::of_view;

    const CAMERA: ErpCamera = ErpCamera {
        width: 128,
        height: 64,
    };
    /// Radius of the painted sphere about the world's origin; the cameras have a distance of 1.
    const RADIUS: f32 = 3.0;

    /// Returns the distance to the sphere from a place inside of it.
    fn distance(place: Vec3, ray: Vec3) -> f32 {
        let along = place.dot(ray);
        (along * along + RADIUS * RADIUS - place.length_squared()).sqrt() - along
    }

    /// Returns the image and the inverse distances of a camera inside of the sphere, whose stripes are eight pixels
    /// of the equator wide and more.
    fn seen(pose: &CameraPose) -> (RgbImage, Vec<f32>) {
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let rays = ErpRays::new(width, height);
        let mut image = RgbImage::black(width, height);
        let mut inverse_distances = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let place = pose.centre.as_vec3();
                let ray = pose.to_world.as_mat3() * rays.ray(column, row);
                let distance = distance(place, ray);
                inverse_distances.push(1.0 / distance);
                let point = (place + distance * ray) / RADIUS;
                let stripes = 0.5 + 0.4 * (16.0 * point).map(f32::sin);
                let first = 3 * (row * width + column);
                image.data[first..first + 3].copy_from_slice(&stripes.to_array());
            }
        }
        (image, inverse_distances)
    }

    fn pose(centre: DVec3, turn: f64, time_seconds: f64) -> CameraPose {
        CameraPose {
            to_world: DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(0.5 * turn),
            centre,
            time_seconds,
        }
    }

    /// Returns the root mean square error of the view from the middle. `nearer` is the factor of the first view's
    /// inverse distances.
    fn error(nearer: f32) -> f32 {
        let poses = [
            pose(dvec3(-0.5, 0.0, 0.0), 0.4, 0.0),
            pose(dvec3(0.5, 0.0, 0.0), -0.7, 1.0),
        ];
        let target = pose(DVec3::ZERO, 1.9, 0.5);
        let rig = Rig::new(poses.map(|pose| Placement {
            to_world: pose.to_world,
            centre: pose.centre,
        }))
        .unwrap();
        let views = poses.map(|pose| seen(&pose));
        let mut clouds = [0, 1].map(|view| {
            let (image, inverse_distances) = &views[view];
            let factor = if view == 0 { nearer } else { 1.0 };
            let depth = SweptDepth {
                width: image.width,
                height: image.height,
                inverse_distances: inverse_distances.iter().map(|w| factor * w).collect(),
                confidences: vec![1.0; inverse_distances.len()],
            };
            of_view(image, &depth, &rig, view)
        });
        let group = Group {
            camera: CAMERA,
            context: [0, 1].map(|view| ContextView {
                frame: view as u32,
                camera_pose: poses[view],
                image: views[view].0.clone(),
            }),
            targets: vec![target],
        };
        let made = images(&group, &rig, &mut clouds);
        let (truth, _) = seen(&target);
        let squares = made[0].data.iter().zip(&truth.data);
        let sum: f32 = squares.map(|(a, b)| (a - b).powi(2)).sum();
        let error = (sum / truth.data.len() as f32).sqrt();
        println!("factor {nearer}: root mean square error {error:.4}");
        error
    }

    #[test]
    fn novel_views_keep_the_detail_of_the_input_views() {
        let error = error(1.0);
        // A blur of 0.65 pixels, as of the splats, takes an eighth of the amplitude of 0.4: 0.034.
        assert!(error < 0.02, "{error}");
    }

    #[test]
    fn the_distance_at_which_the_views_agree_wins() {
        let error = error(2.0);
        assert!(error < 0.08, "{error}");
    }
}
