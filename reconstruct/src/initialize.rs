//! First Gaussians: from a point cloud, and from the sky where no point is.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, vec3};
use rayon::prelude::*;
use rstar::RTree;

use crate::{gaussians::static_gaussians::InitialGaussians, scene::TrainingScene};

/// Opacity of first Gaussians (3DGS `scene/gaussian_model.py`).
const POINT_OPACITY: f32 = 0.1;
/// Opacity of the sky shell: there is nothing behind it.
const SHELL_OPACITY: f32 = 0.8;
/// Neighbours whose mean squared distance gives a Gaussian's first scale (3DGS).
const NEIGHBOURS: usize = 3;
/// First scales are kept within this factor of their median, so that duplicate and lonely points
/// give neither dust nor blankets.
const SCALE_SPREAD: f32 = 10.0;
/// The shell's radius over the 95th percentile of the points' distance from the mean camera.
const SHELL_RADIUS_FACTOR: f32 = 1.5;
/// A shell without any points has this radius in camera radii.
const SHELL_RADIUS_WITHOUT_POINTS: f32 = 100.0;

/// Gaussians at the scene's points: colour of the point, isotropic scale from the three nearest
/// neighbours, opacity 0.1.
pub fn from_points(scene: &TrainingScene) -> InitialGaussians {
    let positions = &scene.points.positions;
    let tree = RTree::bulk_load(positions.clone());
    let mut scales: Vec<f32> = positions
        .par_iter()
        .map(|&position| {
            // The first neighbour is the point itself.
            let (sum, count) = tree
                .nearest_neighbor_iter_with_distance_2(position)
                .skip(1)
                .take(NEIGHBOURS)
                .fold((0.0, 0), |(sum, count), (_, squared)| {
                    (sum + squared, count + 1)
                });
            if count == 0 {
                0.0
            } else {
                (sum / count as f32).sqrt()
            }
        })
        .collect();
    let mut sorted = scales.clone();
    sorted.sort_by(f32::total_cmp);
    // All points in one place have no scale of their own: a hundredth of a camera radius.
    let median = sorted
        .get(sorted.len() / 2)
        .copied()
        .filter(|&median| median > 0.0)
        .unwrap_or(0.01);
    for scale in &mut scales {
        *scale = scale.clamp(median / SCALE_SPREAD, median * SCALE_SPREAD);
    }
    InitialGaussians {
        positions: positions.clone(),
        scales,
        colours: scene
            .points
            .colours
            .iter()
            .map(|colour| colour.map(|byte| f32::from(byte) / 255.0))
            .collect(),
        opacities: vec![POINT_OPACITY; positions.len()],
    }
}

/// A shell of Gaussians around the scene, in the directions in which it has no points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SkyShell {
    /// The Gaussians.
    pub gaussians: InitialGaussians,
    /// Directions that were looked at, evenly spread over the sphere.
    pub directions: usize,
}

impl SkyShell {
    /// Share of the sphere without points.
    pub fn open_share(&self) -> f32 {
        self.gaussians.positions.len() as f32 / self.directions.max(1) as f32
    }
}

/// Looks for open sky in `directions` directions from the mean camera, spread evenly over the
/// sphere: a direction is open when no point lies within twice the directions' spacing of it.
///
/// Structure from motion finds no points in the sky; without a shell, Gaussians near the camera are
/// stretched to fill it. Colours are the mean over the input views at that direction, which is
/// exact at infinity.
pub fn sky_shell(scene: &TrainingScene, directions: usize) -> SkyShell {
    let points: Vec<[f32; 3]> = scene
        .points
        .positions
        .iter()
        .filter_map(|&position| Vec3::from_array(position).try_normalize())
        .map(|direction| direction.to_array())
        .collect();
    let tree = RTree::bulk_load(points);
    // Mean distance between neighbours on the unit sphere.
    let spacing = (4.0 * PI / directions as f32).sqrt();
    let open: Vec<Vec3> = fibonacci_sphere(directions)
        .into_par_iter()
        .filter(|direction| {
            tree.locate_within_distance(direction.to_array(), (2.0 * spacing).powi(2))
                .next()
                .is_none()
        })
        .collect();
    let radius = shell_radius(scene);
    SkyShell {
        directions,
        gaussians: InitialGaussians {
            positions: open
                .iter()
                .map(|&direction| (direction * radius).to_array())
                .collect(),
            // Half the spacing: neighbours overlap at one standard deviation.
            scales: vec![0.5 * spacing * radius; open.len()],
            colours: open
                .par_iter()
                .map(|&direction| mean_colour(scene, direction))
                .collect(),
            opacities: vec![SHELL_OPACITY; open.len()],
        },
    }
}

fn shell_radius(scene: &TrainingScene) -> f32 {
    let mut distances: Vec<f32> = scene
        .points
        .positions
        .iter()
        .map(|&position| Vec3::from_array(position).length())
        .collect();
    distances.sort_by(f32::total_cmp);
    match distances.get(distances.len() * 95 / 100) {
        // Never so near that the cameras (within one unit) see its parallax.
        Some(&distance) => (SHELL_RADIUS_FACTOR * distance).max(10.0),
        None => SHELL_RADIUS_WITHOUT_POINTS,
    }
}

fn fibonacci_sphere(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    (0..count)
        .map(|index| {
            let y = 1.0 - 2.0 * (index as f32 + 0.5) / count as f32;
            let rho = (1.0 - y * y).max(0.0).sqrt();
            let angle = (golden * index as f32) % TAU;
            vec3(rho * angle.cos(), y, rho * angle.sin())
        })
        .collect()
}

fn mean_colour(scene: &TrainingScene, direction_world: Vec3) -> [f32; 3] {
    let (width, height) = (scene.camera.width as usize, scene.camera.height as usize);
    let mut sum = [0.0; 3];
    for view in &scene.input_views {
        let projection =
            crate::camera::erp::project(&scene.camera, view.view.rotation * direction_world, 1.0);
        let column = (projection.pixel.x as usize).min(width - 1);
        let row = (projection.pixel.y as usize).min(height - 1);
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += f32::from(view.pixels[(row * width + column) * 3 + channel]) / 255.0;
        }
    }
    sum.map(|value| value / scene.input_views.len().max(1) as f32)
}

/// Both sets one after the other.
pub fn join(mut first: InitialGaussians, second: InitialGaussians) -> InitialGaussians {
    first.positions.extend(second.positions);
    first.scales.extend(second.scales);
    first.colours.extend(second.colours);
    first.opacities.extend(second.opacities);
    first
}
