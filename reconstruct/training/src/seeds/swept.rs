//! Points for a scene without points, or with too few. They lie on surfaces that a spherical sweep between its
//! views finds, that other views confirm, and that have no scene point nearby.

use std::f32::consts::TAU;

use glam::Vec3;
use omnilife_engine::{camera::erp, training_view::TrainingView};
use omnilife_schemas::{RgbImage, camera::ErpCamera, points::PointCloud};
use rand::RngExt;
use rstar::RTree;

use crate::{
    random::{Purpose, stream},
    scene::TrainingScene,
    stereo::{self, Placement, SweepSettings, SweptDepth, warp::ErpRays},
};

/// Maximum number of swept views, evenly from all input views.
const REFERENCES: usize = 12;
/// Maximum number of views for finding bare surfaces, evenly from all input views.
const TRIALS: usize = 6;
/// Tried gaps between the two views of a pair.
const GAPS: [usize; 4] = [1, 2, 4, 8];
/// Width of images for trying gaps, and for the sweeps, pixels.
const TRIAL_WIDTH: usize = 128;
const SEARCH_WIDTH: usize = 256;
/// Minimum parallax of a distance, pixels of the search; below it a distance is a guess.
const LEAST_PARALLAX: f32 = 1.0;
/// Minimum parallax of a good distance in the comparison of gaps, pixels.
const GOOD_PARALLAX: f32 = 2.0;
/// Minimum confidence of a match.
const LEAST_CONFIDENCE: f32 = 0.1;
/// Maximum difference of a second pair, in steps of the search; beyond it the pair sees past a point.
const AGREEING_STEPS: f32 = 2.0;
const PAST_STEPS: f32 = 4.0;
/// Maximum distance of a scene point that covers a place, degrees in its view: three pixels of [`SEARCH_WIDTH`].
const NEAR_DEGREES: f32 = 4.218_75;
/// Minimum value of masked pixels.
const MASKED: u8 = 128;
/// Weight of a pixel without any detail, over the mean: flat walls get points, too.
const FLAT_WEIGHT: f32 = 0.5;

/// Points of a sweep, with its settings.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptPoints {
    /// The points, normalized units.
    pub points: PointCloud<f32>,
    /// Number of swept pairs of views.
    pub pairs: usize,
    /// Gap between the two views of a pair, in input views.
    pub gap: usize,
    /// Share of the pixels with a distance that both views of the pair agree on.
    pub confirmed: f32,
}

/// Bare share of a scene's surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BareSurfaces {
    /// Places on surfaces that pairs of views agree on.
    pub places: usize,
    /// Number of those without a near scene point.
    pub bare: usize,
}

impl BareSurfaces {
    /// Returns the share of bare places, 0 to 1.
    pub fn share(&self) -> f64 {
        self.bare as f64 / self.places.max(1) as f64
    }
}

/// Finds surfaces without near scene points, at a few places and a small size. `None` if all views stand in one
/// place, or the views are not panoramas.
pub fn bare_surfaces(scene: &TrainingScene) -> Option<BareSurfaces> {
    let gap = best_gap(scene)?;
    let given = RTree::bulk_load(scene.points.positions.clone());
    let mut found = BareSurfaces { places: 0, bare: 0 };
    for reference in references(scene, TRIALS, gap, TRIAL_WIDTH) {
        let candidates = reference.candidates();
        found.places += candidates.len();
        let near_pixels = reference.near_pixels();
        let is_bare = |candidate: &&Candidate| candidate.is_bare(&given, near_pixels);
        found.bare += candidates.iter().filter(is_bare).count();
    }
    (found.places > 0).then_some(found)
}

/// Returns points on visible surfaces without near scene points, at most `maximum`, denser where the views have
/// detail. `None` if all views stand in one place, or the views are not panoramas.
pub fn points(scene: &TrainingScene, maximum: usize, seed: u64) -> Option<SweptPoints> {
    let gap = best_gap(scene)?;
    let references = references(scene, REFERENCES, gap, SEARCH_WIDTH);
    let near_pixels = references.first()?.near_pixels();
    let mut candidates = Vec::new();
    let (mut pixels, mut confirmed) = (0, 0);
    for (number, reference) in references.iter().enumerate() {
        let shown = reference.shown();
        pixels += shown.len();
        let is_confirmed = |&&at: &&usize| reference.depth.confidences[at] >= LEAST_CONFIDENCE;
        confirmed += shown.iter().filter(is_confirmed).count();
        let found = reference.candidates();
        candidates.extend(
            found
                .into_iter()
                .filter(|candidate| is_kept(candidate, number, &references)),
        );
    }
    let given = RTree::bulk_load(scene.points.positions.clone());
    candidates.retain(|candidate| candidate.is_bare(&given, near_pixels));
    Some(SweptPoints {
        points: thinned(&candidates, maximum, seed),
        pairs: references.len(),
        gap,
        confirmed: confirmed as f32 / pixels.max(1) as f32,
    })
}

/// Returns at most so many input views, evenly spread, with their depth at a width.
fn references(scene: &TrainingScene, most: usize, gap: usize, width: usize) -> Vec<Reference<'_>> {
    evenly(scene.input_views.len(), most)
        .filter_map(|first| Reference::new(scene, first, gap, width))
        .collect()
}

/// Returns at most so many of the numbers below `count`, evenly spread, the first and the last among them.
fn evenly(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let taken = most.min(count);
    (0..taken).map(move |step| step * (count - 1) / (taken - 1).max(1))
}

/// Returns the gap that gives most pixels a good distance: near views have too little parallax, far ones see
/// different sides of surfaces.
fn best_gap(scene: &TrainingScene) -> Option<usize> {
    if !scene.camera.wraps() {
        return None;
    }
    let views = scene.input_views.len();
    let scored = GAPS
        .into_iter()
        .filter(|&gap| gap < views)
        .filter_map(|gap| {
            let middle = (views - gap) / 2;
            let reference = Reference::new(scene, middle, gap, TRIAL_WIDTH)?;
            let depth = &reference.depth;
            let is_good = |&at: &usize| {
                depth.confidences[at] >= LEAST_CONFIDENCE
                    && reference.parallax(depth.inverse_distances[at]) >= GOOD_PARALLAX
            };
            let good = reference.shown().into_iter().filter(is_good).count();
            Some((good, gap))
        });
    // Among equals the smallest gap.
    let (_, gap) = scored.max_by_key(|&(good, gap)| (good, std::cmp::Reverse(gap)))?;
    Some(gap)
}

/// A view with its depth.
struct Reference<'a> {
    view: &'a TrainingView,
    camera: ErpCamera,
    depth: SweptDepth,
    /// The view's image at the size of the depth.
    image: RgbImage,
    /// Distance of the pair's cameras, normalized units.
    baseline: f32,
}

/// A place on a surface.
struct Candidate {
    position: Vec3,
    colour: [u8; 3],
    /// Size of its pixel there, normalized units.
    size: f32,
    /// Variation of the image there.
    detail: f32,
}

impl Candidate {
    /// Returns true if no point of the scene is nearer than so many pixels of its view.
    fn is_bare(&self, given: &RTree<[f32; 3]>, near_pixels: f32) -> bool {
        let reach = near_pixels * self.size;
        let mut near = given.locate_within_distance(self.position.to_array(), reach * reach);
        near.next().is_none()
    }
}

impl<'a> Reference<'a> {
    /// Sweeps input view `first` against the one `gap` later, or against an earlier one at the end.
    fn new(scene: &'a TrainingScene, first: usize, gap: usize, width: usize) -> Option<Self> {
        let views = &scene.input_views;
        let second = if first + gap < views.len() {
            first + gap
        } else {
            first.checked_sub(gap)?
        };
        let pair = [&views[first], &views[second]];
        let [columns, rows] = scene.camera.size();
        let images = pair.map(|view| stereo::searched_image(view, [columns, rows]));
        let placements = pair.map(|view| Placement {
            to_world: view.view.rotation.as_dmat3().transpose(),
            centre: view.view.centre.as_dvec3(),
        });
        let settings = SweepSettings {
            search_width: width,
            ..SweepSettings::DEFAULT
        };
        let (rig, [depth, _]) = stereo::depths([&images[0], &images[1]], placements, &settings)?;
        Some(Self {
            view: pair[0],
            camera: ErpCamera::new(depth.width as u32, depth.height as u32),
            image: RgbImage::from_rgb8(columns, rows, &pair[0].pixels)
                .resized_by_area(depth.width, depth.height),
            depth,
            baseline: rig.baseline as f32,
        })
    }

    /// Returns the pixels of [`NEAR_DEGREES`].
    fn near_pixels(&self) -> f32 {
        NEAR_DEGREES / 360.0 * self.depth.width as f32
    }

    /// Returns the largest parallax at an inverse distance (per baseline), pixels.
    fn parallax(&self, inverse: f32) -> f32 {
        inverse * self.depth.width as f32 / TAU
    }

    /// Returns every unmasked pixel with a sufficiently accurate distance that both views confirm. Towards the
    /// poles there are fewer, for the same density there.
    fn candidates(&self) -> Vec<Candidate> {
        let (width, height) = (self.depth.width, self.depth.height);
        let rays = ErpRays::new(width, height);
        let mut found = Vec::new();
        let mut debt = 0.0;
        for row in 0..height {
            for column in 0..width {
                let pixel = row * width + column;
                let ray = rays.ray(column, row);
                // One of every 1 / cos(latitude) pixels of a row.
                debt += (1.0 - ray.y * ray.y).max(0.0).sqrt();
                if debt < 1.0 {
                    continue;
                }
                debt -= 1.0;
                let inverse = self.depth.inverse_distances[pixel];
                let is_good = self.depth.confidences[pixel] >= LEAST_CONFIDENCE
                    && self.parallax(inverse) >= LEAST_PARALLAX;
                if !is_good || self.hides(column, row) {
                    continue;
                }
                let distance = self.baseline / inverse;
                let colour = &self.image.data[3 * pixel..3 * pixel + 3];
                found.push(Candidate {
                    position: self.view.view.centre
                        + self.view.view.rotation.transpose() * ray * distance,
                    colour: [0, 1, 2].map(|channel| (colour[channel] * 255.0).round() as u8),
                    size: distance * TAU / width as f32,
                    detail: self.detail(column, row),
                });
            }
        }
        found
    }

    /// Returns the numbers of the pixels that are not ignored.
    fn shown(&self) -> Vec<usize> {
        let width = self.depth.width;
        let is_shown = |at: &usize| self.view.shows_scene(self.in_view(at % width, at / width));
        (0..self.depth.confidences.len()).filter(is_shown).collect()
    }

    /// Returns the number of the view's pixel at the middle of one of the depth.
    fn in_view(&self, column: usize, row: usize) -> usize {
        let camera = self.view.view.camera;
        let (width, height) = (camera.width() as usize, camera.height() as usize);
        let at = [
            (2 * column + 1) * width / (2 * self.depth.width),
            (2 * row + 1) * height / (2 * self.depth.height),
        ];
        at[1] * width + at[0]
    }

    /// Returns true for a pixel that is ignored or moves.
    fn hides(&self, column: usize, row: usize) -> bool {
        let pixel = self.in_view(column, row);
        let moves = self
            .view
            .mask
            .as_ref()
            .is_some_and(|mask| mask[pixel] >= MASKED);
        moves || !self.view.shows_scene(pixel)
    }

    /// Returns the differences from the pixel's neighbours to the right and below, summed over channels.
    fn detail(&self, column: usize, row: usize) -> f32 {
        let (width, height) = (self.depth.width, self.depth.height);
        let at = |column: usize, row: usize| {
            let first = 3 * (row.min(height - 1) * width + column % width);
            Vec3::from_slice(&self.image.data[first..first + 3])
        };
        let here = at(column, row);
        let differences = (at(column + 1, row) - here).abs() + (at(column, row + 1) - here).abs();
        differences.element_sum()
    }

    /// Returns this view's inverse distance in the direction of a place, that of the place, and the search's
    /// step, all per baseline; `None` where the distance is unknown.
    fn look(&self, place: Vec3) -> Option<[f32; 3]> {
        let point = self.view.view.rotation * (place - self.view.view.centre);
        let distance = point.length();
        if distance <= 0.0 {
            return None;
        }
        let pixel = erp::pixel(&self.camera, point);
        let column = (pixel.x as usize).min(self.depth.width - 1);
        let row = (pixel.y as usize).min(self.depth.height - 1);
        let at = row * self.depth.width + column;
        if self.depth.confidences[at] < LEAST_CONFIDENCE || self.hides(column, row) {
            return None;
        }
        let step = SweepSettings::DEFAULT.step_pixels * TAU / self.depth.width as f32;
        Some([
            self.depth.inverse_distances[at],
            self.baseline / distance,
            step,
        ])
    }
}

/// Returns true if a place of view `own` stays: at least as many other views see it as see past it, and none of
/// those sees it in finer pixels.
fn is_kept(candidate: &Candidate, own: usize, references: &[Reference<'_>]) -> bool {
    let (mut seen, mut past, mut is_finest) = (0, 0, true);
    for (number, other) in references.iter().enumerate() {
        if number == own {
            continue;
        }
        let Some([theirs, expected, step]) = other.look(candidate.position) else {
            continue;
        };
        if expected - theirs > PAST_STEPS * step {
            past += 1;
        }
        if (expected - theirs).abs() <= AGREEING_STEPS * step {
            seen += 1;
            let their_size = other.baseline / expected * TAU / other.depth.width as f32;
            is_finest &=
                candidate.size < their_size || (candidate.size == their_size && own < number);
        }
    }
    is_finest && seen >= past
}

/// Returns at most `maximum` of the candidates, each with a probability that rises with its detail.
fn thinned(candidates: &[Candidate], maximum: usize, seed: u64) -> PointCloud<f32> {
    let mean = candidates
        .iter()
        .map(|candidate| candidate.detail)
        .sum::<f32>()
        / candidates.len().max(1) as f32;
    let weight = |candidate: &Candidate| candidate.detail + FLAT_WEIGHT * mean + f32::MIN_POSITIVE;
    let share = |factor: f32, candidate: &Candidate| (factor * weight(candidate)).min(1.0);
    let expected = |factor: f32| -> f32 {
        candidates
            .iter()
            .map(|candidate| share(factor, candidate))
            .sum()
    };
    let (mut low, mut high) = (0.0, 1.0);
    while expected(high) < (maximum.min(candidates.len()) as f32) * 0.999 && high < 1e30 {
        high *= 2.0;
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if expected(middle) > maximum as f32 {
            high = middle;
        } else {
            low = middle;
        }
    }
    let factor = if candidates.len() <= maximum {
        high
    } else {
        low
    };
    let mut random = stream(seed, Purpose::SweptPoints);
    let mut points = PointCloud::default();
    for candidate in candidates {
        let is_taken = random.random_range(0.0..1.0) < share(factor, candidate);
        if is_taken && points.len() < maximum {
            points.positions.push(candidate.position.to_array());
            points.colours.push(candidate.colour);
        }
    }
    points
}
