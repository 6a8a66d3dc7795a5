//! Dense first Gaussians: oriented samples of some views' distances, each of the same solid angle.
//!
//! * Each view is sampled along the directions of a Fibonacci lattice, so that a sample stands for `4 pi / n` steradians
//!   of it, at the poles and across the seam as elsewhere. A sample lies on the tangent plane of the pixel that shows its
//!   direction, flat along it, and reaches its neighbours (PanoGS, Eqs. 6 to 8, by [`lift()`]).
//! * A place that several views see belongs to one of them ([`Agreement::is_own`]). Two views
//!   that see past a sample outvote fewer that see it.
//! * The lattice is as fine as the limit on the samples allows, and no finer than the pixels of the images.
//! * First opacities follow confidence: that of the distance, and the share of the views that agree with it.
//!
//! A dense start replaces the growth of few Gaussians into many: Kotovenko et al., "EDGS: Eliminating Densification for
//! Efficient Convergence of 3DGS", CVPR 2026.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use omnilife_engine::{
    camera::{Camera, CameraKernels, nearest::Projector},
    gaussians::static_gaussians::InitialGaussians,
    model::exposure::Exposure,
    training_view::TrainingView,
};
use omnilife_schemas::{RgbImage, distances::EDGE_RATIO};
use rayon::prelude::*;

use super::{
    Agreement, DistanceView, LiftSettings, SourceView, SurfaceSamples, agreement,
    checks::differ,
    fit_scales,
    lift::{lift, pixel_angle, pixel_steradians, sample_radius, z_onto},
    scaled,
    sources::{Origin, Sources},
    tolerance,
};
use crate::{scene::TrainingScene, seeds::sky::fibonacci_direction};

/// Minimum number of views that see past a sample for leaving it out.
const GHOST_VIEWS: u16 = 2;
/// First opacities of samples without any confidence, and with all of it.
const OPACITIES: [f32; 2] = [0.3, 0.9];
/// Directions of the first lattice, over those that have the limit's number of samples on the mean: more than the
/// lattice's chances at edges.
const CHANCES: f64 = 1.05;
/// Shape of the samples: that of samples of which no other view has a finer one.
const SHAPE: LiftSettings = LiftSettings {
    // The lattice is even by itself.
    thins_poles: false,
    ..LiftSettings::OF_BEST_VIEWS
};

/// Surfaces that some views know, each of them those that it does not leave to another view.
#[derive(Debug)]
pub struct DenseSurfaces<'a> {
    images: Vec<&'a TrainingView>,
    /// Distances at the pixels of samples alone.
    views: Vec<SourceView>,
    layers: Vec<Layer>,
    tolerance: f64,
    /// Origin of the distances, in words.
    pub origin: String,
    /// Median relative difference of two views' distances to one surface.
    pub disagreement: f64,
    /// That difference before each view got a factor on its distances; `None` without factors.
    pub disagreement_before: Option<f64>,
}

/// The samples of a view's pixels.
#[derive(Debug)]
struct Layer {
    lifted: SurfaceSamples,
    /// Confidence of each sample, in [0, 1].
    confidences: Vec<f32>,
    /// The sample of each pixel; `None` where the view has none, or leaves it to another view.
    sample_of: Vec<Option<u32>>,
}

/// Samples of equal solid angles.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DenseSamples {
    /// The Gaussians, normalized units; the third axis is along the normal.
    pub gaussians: InitialGaussians,
    /// Number of directions of the lattice, of which each sample is one in its view.
    pub directions: usize,
}

/// A sample to be made: its view, the sample of its pixel, and its direction in the camera's frame.
#[derive(Debug, Clone, Copy)]
struct Place {
    view: usize,
    sample: usize,
    direction: Vec3,
}

impl<'a> DenseSurfaces<'a> {
    /// Lifts the distances of some views of a scene, and shares their surfaces out. Distances of files get a factor for
    /// each view where the views disagree.
    pub fn of(scene: &'a TrainingScene, sources: Sources) -> Self {
        let Sources {
            mut views,
            numbers,
            origin_kind,
            origin,
            ..
        } = sources;
        let fit = fit_scales(&as_given(&views));
        let mut disagreement = fit.disagreement_before;
        // The scale of a sweep is that of the poses.
        let is_scaled = origin_kind == Origin::Files && differ(disagreement);
        if is_scaled {
            scaled(&mut views, &fit);
            disagreement = fit.disagreement_after;
        }
        let tolerance = tolerance(disagreement);
        let lifted: Vec<SurfaceSamples> = as_given(&views)
            .iter()
            .enumerate()
            .map(|(number, view)| without_shapes(lift(view, number as u64, &SHAPE)))
            .collect();
        // A place is left to a view only where that view has a sample.
        for (view, lifted) in views.iter_mut().zip(&lifted) {
            keep_pixels(&mut view.distances.values, &lifted.pixels);
        }
        let given = as_given(&views);
        let layers = lifted.into_iter().enumerate();
        let layers = layers.map(|(own, lifted)| {
            let found = agreement(&lifted, own, &given, tolerance);
            Layer::new(lifted, &found, given[own].distances.values.len())
        });
        let layers = layers.collect();
        Self {
            images: numbers
                .iter()
                .map(|&view| &scene.input_views[view])
                .collect(),
            views,
            layers,
            tolerance,
            origin,
            disagreement,
            disagreement_before: is_scaled.then_some(fit.disagreement_before),
        }
    }

    /// Returns the number of views.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Returns true without views.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Returns the share of the views' pixels with a sample, 0 to 1.
    pub fn known_share(&self) -> f64 {
        let pixels: usize = self.layers.iter().map(|layer| layer.sample_of.len()).sum();
        let known: usize = self.layers.iter().map(|layer| layer.lifted.len()).sum();
        known as f64 / pixels.max(1) as f64
    }

    /// Returns, for each position, true if a view has a surface there: a Gaussian there shows nothing more. Other input
    /// views may see a place behind the surfaces.
    pub fn cover(&self, positions: &[[f32; 3]]) -> Vec<bool> {
        let projectors = self.views.iter();
        let projectors: Vec<Projector> = projectors
            .map(|view| Projector::new(&view.view.view))
            .collect();
        let tolerance = self.tolerance as f32;
        let is_covered = |position: &[f32; 3]| {
            let mut views = self.views.iter().zip(&projectors);
            views.any(|(view, projector)| {
                let seen = projector.pixel(Vec3::from_array(*position));
                seen.is_some_and(|(pixel, distance)| {
                    let theirs = view.distances.values[pixel];
                    theirs > 0.0 && (theirs - distance).abs() < tolerance * distance
                })
            })
        };
        positions.par_iter().map(is_covered).collect()
    }

    /// Returns at most `maximum` samples; with an exposure, without its gains.
    pub fn samples(&self, maximum: usize, exposure: Option<&Exposure>) -> DenseSamples {
        let (directions, places) = self.lattice(maximum);
        if directions == 0 {
            return DenseSamples::default();
        }
        let pitch = (4.0 * PI / directions as f64).sqrt();
        let images: Vec<TargetImage> = self
            .images
            .iter()
            .map(|view| TargetImage::new(view, pitch))
            .collect();
        let mut gaussians = InitialGaussians::default();
        for place in places {
            let Some(shown) = images[place.view].colour(place.direction) else {
                continue;
            };
            let (position, radius, normal) = self.surface(place, pitch);
            let view = &self.images[place.view].view;
            let colour = exposure.map_or(shown, |exposure| {
                exposure.normalized(shown, view.time_seconds)
            });
            gaussians.positions.push(position.to_array());
            gaussians.scales.push(SHAPE.scales(radius));
            gaussians.rotations.push(z_onto(normal));
            gaussians.colours.push(colour);
            let confidence = self.layers[place.view].confidences[place.sample];
            gaussians.opacities.push(opacity(confidence));
        }
        DenseSamples {
            gaussians,
            directions,
        }
    }

    /// Returns the finest lattice with at most `maximum` samples in all views together: the number of its directions,
    /// and the samples.
    fn lattice(&self, maximum: usize) -> (usize, Vec<Place>) {
        let cameras = self.images.iter().map(|view| &view.view.camera);
        let Some(finest) = cameras.map(directions_of_pixels).max() else {
            return (0, Vec::new());
        };
        let mut directions = finest.min(self.most_directions(maximum));
        while directions > 0 {
            let places = self.places(directions);
            if places.len() <= maximum {
                return (directions, places);
            }
            // Samples are in proportion to directions, up to the lattice's chances at edges.
            let next = (directions as f64 * maximum as f64 / places.len() as f64) as usize;
            directions = next.min(directions - 1);
        }
        (0, Vec::new())
    }

    /// Returns a number of directions with at least `maximum` samples, by the solid angle of the views' own pixels:
    /// `1.05 maximum 4 pi / omega`. No finer lattice has to be tried.
    fn most_directions(&self, maximum: usize) -> usize {
        let of_views = self.views.par_iter().zip(&self.layers);
        let of_views = of_views.map(|(view, layer)| {
            let samples = layer.sample_of.iter().enumerate();
            let own = samples.filter(|(_, sample)| sample.is_some());
            own.map(|(pixel, _)| pixel_steradians(&view.view.view.camera, pixel))
                .sum::<f64>()
        });
        // Summed in the views' order.
        let omega: f64 = of_views.collect::<Vec<_>>().iter().sum();
        (CHANCES * maximum as f64 * 4.0 * PI / omega).ceil() as usize
    }

    /// Returns the samples of a lattice of so many directions about every camera.
    fn places(&self, directions: usize) -> Vec<Place> {
        let of_view = |view: usize| {
            let camera = self.views[view].view.view.camera;
            let width = camera.width() as usize;
            let sample_of = &self.layers[view].sample_of;
            let place = |index: usize| {
                let direction = fibonacci_direction(index, directions);
                let [column, row] = camera.pixel_of(direction, 1.0)?;
                let sample = sample_of[row * width + column]? as usize;
                Some(Place {
                    view,
                    sample,
                    direction,
                })
            };
            let indices = (0..directions).into_par_iter();
            indices.filter_map(place).collect::<Vec<_>>()
        };
        (0..self.views.len()).flat_map(of_view).collect()
    }

    /// Returns position, radius and normal of a sample, in the world: on the tangent plane of its pixel's point.
    fn surface(&self, place: Place, pitch: f64) -> (Vec3, f32, Vec3) {
        let view = &self.views[place.view].view.view;
        let lifted = &self.layers[place.view].lifted;
        let normal = lifted.normals[place.sample];
        let point = Vec3::from_array(lifted.gaussians.positions[place.sample]) - view.centre;
        let ray = (view.rotation.transpose() * place.direction).normalize_or(Vec3::Z);
        let distance = on_plane(point.as_dvec3(), normal.as_dvec3(), ray.as_dvec3());
        let cosine = f64::from(normal.dot(ray).abs());
        let radius = sample_radius(distance * pitch, cosine);
        (view.centre + ray * distance as f32, radius as f32, normal)
    }
}

impl Layer {
    /// Keeps the samples that are the view's own, and those that no two views see past.
    fn new(lifted: SurfaceSamples, found: &[Agreement], pixels: usize) -> Self {
        let mut sample_of = vec![None; pixels];
        let mut confidences = Vec::with_capacity(found.len());
        for (sample, found) in found.iter().enumerate() {
            let [support, free] = [found.support, found.free];
            let agreeing = f32::from(support + 1) / f32::from(support + 1 + free);
            confidences.push(lifted.confidences[sample] * agreeing);
            let is_ghost = free >= GHOST_VIEWS && free > support;
            if found.is_own && !is_ghost {
                sample_of[lifted.pixels[sample] as usize] = Some(sample as u32);
            }
        }
        Self {
            lifted,
            confidences,
            sample_of,
        }
    }
}

/// An image whose pixels are as large as samples.
struct TargetImage {
    camera: Camera,
    image: RgbImage,
}

impl TargetImage {
    /// Averages a view's image over pixels of this pitch, radians; a finer one keeps its size.
    fn new(view: &TrainingView, pitch: f64) -> Self {
        let camera = view.view.camera;
        let [width, height] = camera.size();
        let coarseness = (pitch / pixel_angle(&camera, DVec3::Z)).max(1.0);
        let [columns, rows] =
            [width, height].map(|side| ((side as f64 / coarseness).round() as usize).max(1));
        let image = RgbImage::from_rgb8(width, height, &view.pixels);
        Self {
            camera: camera.resized(columns as u32, rows as u32),
            image: image.resized_by_area(columns, rows),
        }
    }

    /// Returns the colour in a direction; `None` for one that the image does not show.
    fn colour(&self, direction: Vec3) -> Option<[f32; 3]> {
        let [column, row] = self.camera.pixel_of(direction, 1.0)?;
        let first = 3 * (row * self.image.width + column);
        Some([0, 1, 2].map(|channel| self.image.data[first + channel]))
    }
}

fn as_given(views: &[SourceView]) -> Vec<DistanceView<'_>> {
    views.iter().map(SourceView::as_given).collect()
}

/// Drops scales, rotations, colours and opacities: samples get those of their lattice.
fn without_shapes(mut lifted: SurfaceSamples) -> SurfaceSamples {
    lifted.gaussians = InitialGaussians {
        positions: lifted.gaussians.positions,
        ..InitialGaussians::default()
    };
    lifted
}

/// Sets the distances of all other pixels to unknown.
fn keep_pixels(distances: &mut [f32], pixels: &[u32]) {
    let mut kept = vec![0.0; distances.len()];
    for &pixel in pixels {
        kept[pixel as usize] = distances[pixel as usize];
    }
    distances.copy_from_slice(&kept);
}

/// Returns the number of directions on the sphere that are as far apart as the pixels at an image's centre.
fn directions_of_pixels(camera: &Camera) -> usize {
    let pitch = pixel_angle(camera, DVec3::Z);
    ((4.0 * PI / (pitch * pitch)).round() as usize).max(1)
}

/// Returns the distance along a unit ray of the plane through a point, seen from the origin: `n.p / n.r`. The point's own
/// distance where the plane is beyond the next surface: near its horizon.
fn on_plane(point: DVec3, normal: DVec3, ray: DVec3) -> f64 {
    let own = point.length();
    let distance = normal.dot(point) / normal.dot(ray);
    let most = f64::from(EDGE_RATIO);
    if distance > own / most && distance < own * most {
        distance
    } else {
        own
    }
}

/// Returns the first opacity of a sample of this confidence, 0 to 1.
fn opacity(confidence: f32) -> f32 {
    let [least, most] = OPACITIES;
    least + (most - least) * confidence.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests;
