//! First Gaussians in the open sky: a shell around the scene, in the directions without points.
//!
//! Structure from motion finds no points in the sky; without a shell, Gaussians near the camera are
//! stretched to fill it.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, vec3};
use rayon::prelude::*;
use rstar::RTree;

use crate::scene::TrainingScene;
use omnilife_engine::{
    camera::{Camera, CameraKernels},
    gaussians::static_gaussians::InitialGaussians,
    model::exposure::Exposure,
    training_view::TrainingView,
};

/// Maximum number of examined directions for open sky; a limit on the Gaussians may lower it.
pub(crate) const SKY_DIRECTIONS: usize = 8_000;
/// Inverse of the shell's maximum share of all Gaussians.
const SKY_PART: u64 = 4;
/// Minimum open share of the sphere for a shell.
pub const SKY_SHARE: f32 = 0.02;
/// Opacity of the shell: the space behind it is empty.
const SHELL_OPACITY: f32 = 0.8;
/// The shell's radius over the 95th percentile of the points' distance from the mean camera.
const SHELL_RADIUS_FACTOR: f32 = 1.5;
/// Radius of a shell without any points, camera radii.
const SHELL_RADIUS_WITHOUT_POINTS: f32 = 100.0;

/// Directions from the mean camera in which a scene has no points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenSky {
    /// Directions evenly spread over the sphere.
    pub directions: usize,
    /// Number of those in which some input view shows the scene.
    pub seen: usize,
    /// Visible directions without points, unit vectors, world frame.
    pub open: Vec<Vec3>,
}

impl OpenSky {
    /// Examines as many directions as a shell may take of `maximum` Gaussians. A direction is open when no point
    /// lies within twice the directions' spacing of it.
    pub fn of(scene: &TrainingScene, maximum: u64) -> Self {
        let directions = SKY_DIRECTIONS.min((maximum / SKY_PART) as usize).max(1);
        let points: Vec<[f32; 3]> = scene
            .points
            .positions
            .iter()
            .filter_map(|&position| Vec3::from_array(position).try_normalize())
            .map(|direction| direction.to_array())
            .collect();
        let tree = RTree::bulk_load(points);
        let reach = (2.0 * spacing(directions)).powi(2);
        let is_open = |direction: &Vec3| {
            let mut near = tree.locate_within_distance(direction.to_array(), reach);
            near.next().is_none()
        };
        let seen: Vec<Vec3> = fibonacci_sphere(directions)
            .into_par_iter()
            .filter(|&direction| is_seen(scene, direction))
            .collect();
        Self {
            directions,
            seen: seen.len(),
            open: seen.into_par_iter().filter(is_open).collect(),
        }
    }

    /// Returns the share of the visible sphere without points.
    pub fn share(&self) -> f32 {
        self.open.len() as f32 / self.seen.max(1) as f32
    }

    /// Returns true if enough of the sphere is open for a shell.
    pub fn is_worth_a_shell(&self) -> bool {
        self.share() >= SKY_SHARE
    }

    /// Makes the shell. Colours are the mean over the input views at a direction, which is exact at infinity;
    /// with an exposure, without its gains.
    pub fn shell(&self, scene: &TrainingScene, exposure: Option<&Exposure>) -> InitialGaussians {
        let radius = shell_radius(scene);
        let positions = self.open.iter();
        let positions = positions.map(|&direction| (direction * radius).to_array());
        // Half the spacing: neighbours overlap at one standard deviation.
        let scale = 0.5 * spacing(self.directions) * radius;
        let colours = self.open.par_iter();
        let colours = colours.map(|&direction| mean_colour(scene, exposure, direction));
        InitialGaussians::isotropic(
            positions.collect(),
            &vec![scale; self.open.len()],
            colours.collect(),
            vec![SHELL_OPACITY; self.open.len()],
        )
    }
}

/// Returns the mean distance between neighbours on the unit sphere.
fn spacing(directions: usize) -> f32 {
    (4.0 * PI / directions as f32).sqrt()
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
        // Minimum distance at which the cameras (within one unit) see no parallax of the shell.
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

/// Returns true if some input view shows a direction of the world at infinity.
fn is_seen(scene: &TrainingScene, direction_world: Vec3) -> bool {
    match scene.camera {
        Camera::Erp(_) if scene.input_views.iter().any(|view| view.ignored.is_none()) => true,
        _ => scene.input_views.iter().any(|view| {
            let at = view.view.rotation * direction_world;
            pixel_showing(view, at).is_some()
        }),
    }
}

/// Returns the pixel that shows the scene in a direction of the camera; `None` without one.
fn pixel_showing(view: &TrainingView, direction: Vec3) -> Option<usize> {
    let camera = &view.view.camera;
    let [column, row] = camera.pixel_of(direction, 1.0)?;
    let pixel = row * camera.width() as usize + column;
    view.shows_scene(pixel).then_some(pixel)
}

/// Returns the mean over the input views that show a direction.
fn mean_colour(
    scene: &TrainingScene,
    exposure: Option<&Exposure>,
    direction_world: Vec3,
) -> [f32; 3] {
    let (mut sum, mut views) = ([0.0; 3], 0_usize);
    for view in &scene.input_views {
        let at = view.view.rotation * direction_world;
        let Some(pixel) = pixel_showing(view, at) else {
            continue;
        };
        views += 1;
        let shown = [0, 1, 2].map(|channel| f32::from(view.pixels[3 * pixel + channel]) / 255.0);
        let seconds = view.view.time_seconds;
        let colour = exposure.map_or(shown, |exposure| exposure.normalized(shown, seconds));
        for (sum, value) in sum.iter_mut().zip(colour) {
            *sum += value;
        }
    }
    sum.map(|value| value / views.max(1) as f32)
}
