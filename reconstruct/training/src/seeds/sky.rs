//! First Gaussians in the open sky: a shell around the scene, in the directions without points.
//!
//! Structure from motion finds no points in the sky; without a shell, Gaussians near the camera are
//! stretched to fill it. Points are sparse, and a shell of [`OpenSky::of`] keeps away from them: Gaussians that grow
//! close the gap. Samples of pixels are dense and may keep their sizes. For them a shell of [`OpenSky::behind`]
//! reaches the edge of every surface in every view.

use std::f32::consts::PI;

use glam::{Vec3, vec3};
use rayon::prelude::*;
use rstar::RTree;

use crate::{scene::TrainingScene, seeds::depth::DistanceView};
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

    /// Examines directions as far apart as the pixels of views with distances. A direction is open when some view
    /// shows no surface within a pixel of it, at the distance of the shell.
    pub fn behind(scene: &TrainingScene, views: &[DistanceView<'_>]) -> Self {
        let Some(first) = views.first() else {
            return Self::default();
        };
        let radius = shell_radius(scene);
        let pixel = first.view.camera.pixel_radians();
        let directions = (4.0 * PI / (pixel * pixel)).ceil() as usize;
        let seen: Vec<Vec3> = fibonacci_sphere(directions)
            .into_par_iter()
            .filter(|&direction| is_seen(scene, direction))
            .collect();
        let is_open = |direction: &Vec3| {
            let mut views = views.iter();
            views.any(|view| has_gap_near(view, *direction * radius))
        };
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
        self.coloured_shell(scene, |direction| mean_colour(scene, exposure, direction))
    }

    /// Makes the shell with the colours of the pixels without a surface, where some view has one at a direction.
    pub fn shell_behind(
        &self,
        scene: &TrainingScene,
        views: &[DistanceView<'_>],
    ) -> InitialGaussians {
        let radius = shell_radius(scene);
        self.coloured_shell(scene, |direction| {
            let of_gaps = colour_of_gaps(views, direction * radius);
            of_gaps.unwrap_or_else(|| mean_colour(scene, None, direction))
        })
    }

    fn coloured_shell(
        &self,
        scene: &TrainingScene,
        colour: impl Fn(Vec3) -> [f32; 3] + Sync,
    ) -> InitialGaussians {
        let radius = shell_radius(scene);
        let positions = self.open.iter();
        let positions = positions.map(|&direction| (direction * radius).to_array());
        // Half the spacing: neighbours overlap at one standard deviation.
        let scale = 0.5 * spacing(self.directions) * radius;
        let colours = self.open.par_iter();
        let colours = colours.map(|&direction| colour(direction));
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

/// Returns unit vectors evenly spread over the sphere, each in the middle of an equal solid angle.
fn fibonacci_sphere(count: usize) -> Vec<Vec3> {
    // The angles of many directions exceed the precision of f32.
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|index| {
            let y = 1.0 - 2.0 * (index as f32 + 0.5) / count as f32;
            let rho = (1.0 - y * y).max(0.0).sqrt();
            let angle = ((golden * index as f64) % std::f64::consts::TAU) as f32;
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

/// Returns the column and row of the pixel of a view that shows a place; `None` for a place outside its image.
fn pixel_at(view: &DistanceView<'_>, place: Vec3) -> Option<[usize; 2]> {
    let at = view.view.rotation * (place - view.view.centre);
    view.view.camera.pixel_of(at, at.length())
}

/// Returns true for a pixel of the scene without a surface.
fn is_gap(view: &DistanceView<'_>, pixel: usize) -> bool {
    view.distances.values[pixel] <= 0.0 && !view.hides(pixel)
}

/// Returns true if a view shows no surface at a place, or in a pixel beside it.
fn has_gap_near(view: &DistanceView<'_>, place: Vec3) -> bool {
    let Some([column, row]) = pixel_at(view, place) else {
        return false;
    };
    let (width, height) = (view.distances.width, view.distances.height);
    let beside = |step: usize| match view.distances.wraps {
        true => (column + width + step - 1) % width,
        false => (column + step).saturating_sub(1).min(width - 1),
    };
    (row.saturating_sub(1)..=(row + 1).min(height - 1))
        .any(|row| (0..3).any(|step| is_gap(view, row * width + beside(step))))
}

/// Returns the mean over the views that show no surface at a place; `None` without one.
fn colour_of_gaps(views: &[DistanceView<'_>], place: Vec3) -> Option<[f32; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0_usize);
    for view in views {
        let Some([column, row]) = pixel_at(view, place) else {
            continue;
        };
        let pixel = row * view.distances.width + column;
        if is_gap(view, pixel) {
            count += 1;
            for (channel, sum) in sum.iter_mut().enumerate() {
                *sum += f32::from(view.pixels[3 * pixel + channel]) / 255.0;
            }
        }
    }
    (count > 0).then(|| sum.map(|value| value / count as f32))
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
