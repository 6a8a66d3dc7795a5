//! First dynamic Gaussians: on masked pixels.
//!
//! Structure from motion has no points on moving objects, and at first all Gaussians are static. The losses of
//! dynamic Gaussians alone would have an empty render and no gradient (the cold start of Omni4DGS). So Gaussians
//! are placed on the masked pixels of the input views, at the views' times.
//!
//! A pixel has no depth. An object hides everything behind it: it is no farther than the nearest scene point in
//! its silhouette. For an object that stands on the ground, that is the ground at its foot. Each connected
//! component of a mask gets one distance, the 10th percentile of the points in it.
//!
//! On request, seeds start with a velocity: that of their component from the view before to the view after,
//! across the line of sight. If one of those does not show it, the view itself takes its place. Components are
//! the same where each is the other's nearest, within a few degrees, and of about the same size. The velocity
//! along the line of sight is unknown.

use std::f32::consts::PI;

use glam::Vec3;
use omnilife_schemas::{camera::CameraModel, statistics};
use rayon::prelude::*;

use crate::scene::TrainingScene;
use omnilife_engine::{
    camera::{Camera, CameraKernels},
    clock::Clock,
    gaussians::{static_gaussians::InitialGaussians, temporal::InitialTimes},
    model::exposure::Exposure,
    training_view::TrainingView,
};

/// Opacity of a seed: its existence is known.
const SEED_OPACITY: f32 = 0.5;
/// The share of a component's points that may be nearer than it.
const NEAR_SHARE: f32 = 0.1;
/// Minimum coverage of a masked pixel.
const COVERED: u8 = 128;
/// Maximum angle between components of neighbouring views that are the same, radians.
const LARGEST_STEP: f32 = 0.2;
/// Maximum ratio of their areas.
const LARGEST_GROWTH: f32 = 1.6;
/// Minimum number of points for a component's own distance; others take that of the view's median component.
const LEAST_POINTS: usize = 3;

/// First dynamic Gaussians.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MaskSeeds {
    /// The Gaussians.
    pub gaussians: InitialGaussians,
    /// Their times.
    pub times: InitialTimes,
    /// Number of masked pixels of all input views, from which seeds were taken evenly.
    pub masked_pixels: usize,
    /// Number of seeds without points of their own component for their distance.
    pub without_points: usize,
}

/// A connected component of a view's mask.
#[derive(Debug, Clone)]
struct ConnectedComponent {
    pixels: Vec<usize>,
    /// Unit direction to its middle, world.
    direction: Vec3,
    /// Solid angle, steradians.
    area: f32,
    distance: f32,
    has_points: bool,
}

/// A masked pixel of a component of a view.
#[derive(Debug, Clone, Copy)]
struct MaskedPixel {
    view: usize,
    component: usize,
    pixel: usize,
}

/// Choice of the seeds' first velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeedVelocity {
    /// Rest.
    None,
    /// The velocity of their component across the line of sight.
    Tracked,
}

/// Settings of the seeds.
#[derive(Debug, Clone, Copy)]
pub struct SeedSettings<'a> {
    /// Clock from seconds to frames.
    pub clock: Clock,
    /// First lifespan of a seed, frames.
    pub lifespan_frames: f32,
    /// First velocities.
    pub velocity: SeedVelocity,
    /// Gains that are removed from the colours.
    pub exposure: Option<&'a Exposure>,
    /// Maximum number of seeds.
    pub maximum: usize,
    /// Pixels of each view that get none; views without any have no entries.
    pub explained: &'a [Vec<bool>],
}

impl SeedSettings<'_> {
    fn is_explained(&self, at: &MaskedPixel) -> bool {
        let view = self.explained.get(at.view);
        view.and_then(|pixels| pixels.get(at.pixel))
            .is_some_and(|&is| is)
    }
}

/// Places seeds, evenly from all masked pixels.
pub fn mask_seeds(scene: &TrainingScene, settings: &SeedSettings<'_>) -> MaskSeeds {
    let SeedSettings {
        clock,
        lifespan_frames,
        ..
    } = *settings;
    let components: Vec<Vec<ConnectedComponent>> = scene
        .input_views
        .par_iter()
        .map(|view| components(scene, view))
        .collect();
    let all: Vec<MaskedPixel> = components
        .iter()
        .enumerate()
        .flat_map(|(view, components)| {
            components
                .iter()
                .enumerate()
                .map(move |(n, component)| (view, n, component))
        })
        .flat_map(|(view, number, component)| {
            component.pixels.iter().map(move |&pixel| MaskedPixel {
                view,
                component: number,
                pixel,
            })
        })
        .filter(|at| !settings.is_explained(at))
        .collect();
    let count = all.len().min(settings.maximum);
    let mut seeds = MaskSeeds {
        masked_pixels: all.len(),
        ..MaskSeeds::default()
    };
    if count == 0 {
        return seeds;
    }
    // The seeds of all views within a lifespan show a pixel: so many fewer are enough.
    let pixels_per_seed = all.len() as f32 / count as f32 / lifespan_frames.max(1.0);
    let spread = pixels_per_seed.max(1.0).sqrt();
    let velocities: Vec<Vec<Vec3>> = match settings.velocity {
        SeedVelocity::None => components
            .iter()
            .map(|all| vec![Vec3::ZERO; all.len()])
            .collect(),
        SeedVelocity::Tracked => tracked_velocities(scene, &clock, &components),
    };
    for step in 0..count {
        let at = all[step * all.len() / count];
        let view = &scene.input_views[at.view];
        let component = &components[at.view][at.component];
        let direction = direction(&scene.camera, view, at.pixel);
        let pitch = scene.camera.pixel_radians() * component.distance;
        let position = view.view.centre + direction * component.distance;
        let rgb = &view.pixels[3 * at.pixel..3 * at.pixel + 3];
        let seconds = view.view.time_seconds;
        let shown = [0, 1, 2].map(|channel| f32::from(rgb[channel]) / 255.0);
        let colour = settings
            .exposure
            .map_or(shown, |exposure| exposure.normalized(shown, seconds));
        seeds.gaussians.push_isotropic(
            position.to_array(),
            0.5 * pitch * spread,
            colour,
            SEED_OPACITY,
        );
        let peak = clock.frame(seconds) as f32;
        seeds.times.peaks.push(peak);
        seeds.times.lifespans.push(lifespan_frames);
        let velocity = velocities[at.view][at.component];
        seeds.times.velocities.push(velocity.to_array());
        seeds.without_points += usize::from(!component.has_points);
    }
    seeds
}

/// Returns the velocity of every component of every view, units per frame: from its position in the view before
/// to that in the view after. If one of them does not show it, the position in the view itself takes its place;
/// zero if neither does.
fn tracked_velocities(
    scene: &TrainingScene,
    clock: &Clock,
    components: &[Vec<ConnectedComponent>],
) -> Vec<Vec<Vec3>> {
    let mut order: Vec<usize> = (0..components.len()).collect();
    order.sort_by_key(|&view| scene.input_views[view].frame);
    let mut velocities: Vec<Vec<Vec3>> = components
        .iter()
        .map(|components| vec![Vec3::ZERO; components.len()])
        .collect();
    for at in 0..order.len() {
        let now = order[at];
        let around = [at.checked_sub(1), Some(at + 1)]
            .map(|place| place.and_then(|place| order.get(place)).copied());
        for (number, component) in components[now].iter().enumerate() {
            let found = around.map(|view| {
                let view = view?;
                let same = same_component(number, &components[now], &components[view])?;
                Some((view, same))
            });
            let here = (now, component);
            let ends = match found {
                [Some(first), Some(last)] => [first, last],
                [Some(first), None] => [first, here],
                [None, Some(last)] => [here, last],
                [None, None] => continue,
            };
            let [(from, begin), (to, end)] = ends.map(|(view, same)| {
                let view = &scene.input_views[view].view;
                let place = view.centre + same.direction * component.distance;
                (place, clock.frame(view.time_seconds))
            });
            let velocity = (to - from) / (end - begin) as f32;
            let radial = component.direction * component.direction.dot(velocity);
            velocities[now][number] = velocity - radial;
        }
    }
    velocities
}

/// Returns the component among `others` that is component `number` of `all`.
fn same_component<'p>(
    number: usize,
    all: &[ConnectedComponent],
    others: &'p [ConnectedComponent],
) -> Option<&'p ConnectedComponent> {
    let nearest = |to: &ConnectedComponent, among: &[ConnectedComponent]| {
        let angle = |other: &ConnectedComponent| to.direction.dot(other.direction);
        (0..among.len()).max_by(|&a, &b| angle(&among[a]).total_cmp(&angle(&among[b])))
    };
    let component = &all[number];
    let found = nearest(component, others)?;
    let other = &others[found];
    let growth = (other.area / component.area).max(component.area / other.area);
    let is_same = nearest(other, all) == Some(number)
        && component.direction.dot(other.direction) > LARGEST_STEP.cos()
        && growth < LARGEST_GROWTH;
    is_same.then_some(other)
}

/// Returns the world direction of a pixel's centre.
fn direction(camera: &Camera, view: &TrainingView, pixel: usize) -> Vec3 {
    let width = camera.width() as usize;
    let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
    let ray = camera.unproject(centre).as_vec3();
    view.view.rotation.transpose() * ray
}

/// Returns the components of one view's mask.
fn components(scene: &TrainingScene, view: &TrainingView) -> Vec<ConnectedComponent> {
    let Some(mask) = &view.mask else {
        return Vec::new();
    };
    let [width, height] = scene.camera.size();
    let (labels, count) = connected_components(mask, width, scene.camera.wraps());
    let mut points: Vec<Vec<f32>> = vec![Vec::new(); count];
    for &position in &scene.points.positions {
        let point = view.view.rotation * (Vec3::from_array(position) - view.view.centre);
        let distance = point.length();
        if let Some([column, row]) = scene.camera.pixel_of(point, distance)
            && let Some(component) = labels[row * width + column]
        {
            points[component].push(distance);
        }
    }
    let distances: Vec<Option<f32>> = points.into_iter().map(near_distance).collect();
    let known: Vec<f32> = distances.iter().flatten().copied().collect();
    let otherwise =
        statistics::median(&known).unwrap_or_else(|| scene.median_point_distance().max(1.0));
    let mut components: Vec<ConnectedComponent> = distances
        .into_iter()
        .map(|distance| ConnectedComponent {
            pixels: Vec::new(),
            direction: Vec3::ZERO,
            area: 0.0,
            distance: distance.unwrap_or(otherwise),
            has_points: distance.is_some(),
        })
        .collect();
    let pitch = scene.camera.pixel_radians();
    for (pixel, label) in labels.into_iter().enumerate() {
        let Some(label) = label else { continue };
        let component = &mut components[label];
        let area = pitch * pitch * area_of_pixel(&scene.camera, pixel, [width, height]);
        component.pixels.push(pixel);
        component.area += area;
        component.direction += direction(&scene.camera, view, pixel) * area;
    }
    for component in &mut components {
        component.direction = component.direction.normalize_or_zero();
    }
    components
}

/// Returns the solid angle of a pixel over that of one at the image centre.
fn area_of_pixel(camera: &Camera, pixel: usize, [width, height]: [usize; 2]) -> f32 {
    match camera {
        Camera::Erp(_) => {
            let latitude = PI * (0.5 - ((pixel / width) as f32 + 0.5) / height as f32);
            latitude.cos()
        }
        Camera::Pinhole(camera) => {
            let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            // The unit ray's z is the cosine of the angle to the axis; solid angles fall with its cube.
            (camera.unproject(centre).z as f32).powi(3)
        }
    }
}

/// Returns the distance of a component from those of the points in it.
fn near_distance(mut distances: Vec<f32>) -> Option<f32> {
    distances.sort_by(f32::total_cmp);
    let nearest = (NEAR_SHARE * distances.len() as f32) as usize;
    (distances.len() >= LEAST_POINTS).then(|| distances[nearest])
}

/// Numbers the connected components of a mask (4 neighbours, around the seam where columns wrap); returns the
/// number of each pixel's component and the number of components.
fn connected_components(mask: &[u8], width: usize, wraps: bool) -> (Vec<Option<usize>>, usize) {
    let mut labels = vec![None; mask.len()];
    let mut components = 0;
    let mut open = Vec::new();
    for first in 0..mask.len() {
        if mask[first] < COVERED || labels[first].is_some() {
            continue;
        }
        labels[first] = Some(components);
        open.push(first);
        while let Some(pixel) = open.pop() {
            let (row, column) = (pixel / width, pixel % width);
            let left = (wraps || column > 0).then_some(width - 1);
            let right = (wraps || column + 1 < width).then_some(1);
            let sideways = left.into_iter().chain(right);
            let sideways = sideways.map(|step| row * width + (column + step) % width);
            let above = pixel.checked_sub(width);
            let below = (pixel + width < mask.len()).then_some(pixel + width);
            for neighbour in sideways.chain(above).chain(below) {
                if mask[neighbour] >= COVERED && labels[neighbour].is_none() {
                    labels[neighbour] = Some(components);
                    open.push(neighbour);
                }
            }
        }
        components += 1;
    }
    (labels, components)
}

#[cfg(test)]
mod tests;
