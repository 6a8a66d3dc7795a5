//! Comparisons of two views' distances.

use glam::Vec3;
use omnilife_engine::camera::nearest::Projector;
use omnilife_schemas::distances::DistanceImage;
use rayon::prelude::*;

use super::{
    lift::{DistanceView, MASKED},
    normals::Points,
};

/// Steps between the columns and the rows of examined pixels: one pixel in eight.
const STEPS: [usize; 2] = [4, 2];

/// Maximum difference of two views' values at one surface, a logarithm.
pub(super) const ONE_SURFACE: f64 = 0.1;
/// Minimum number of places for a comparison of views.
pub(super) const LEAST_PLACES: usize = 500;

/// A place of one view that another one sees.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    /// `log(D_j / |x - c_j|)`: above 0 the second view sees past the place.
    pub(super) log_ratio: f64,
    /// Derivative of `log |x - c_j|` by the logarithm of the first view's distances.
    pub(super) slope: f64,
    /// The pixel of the first view, and that of the second one.
    pub(super) pixels: [usize; 2],
}

/// Views with factors on their distances.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScaledViews<'a> {
    pub(super) views: &'a [DistanceView<'a>],
    /// Logarithms of the factors.
    pub(super) log_scales: &'a [f64],
}

impl ScaledViews<'_> {
    /// Returns every unmasked place of view `first` that `second` sees.
    pub(super) fn sightings(&self, first: usize, second: usize) -> Vec<Sighting> {
        let (from, to) = (&self.views[first], &self.views[second]);
        let [scale, other_scale] = [first, second].map(|view| self.log_scales[view].exp());
        let points = Points::new(from.view.camera, from.distances);
        let projector = Projector::new(to.view);
        let to_world = from.view.rotation.transpose();
        let (width, height) = (from.distances.width, from.distances.height);
        let mut found = Vec::new();
        for row in (0..height).step_by(STEPS[1]) {
            for column in ((row / 2) % STEPS[0]..width).step_by(STEPS[0]) {
                let pixel = row * width + column;
                let distance = from.distances.values[pixel];
                if distance <= 0.0 || from.hides(pixel) {
                    continue;
                }
                let arm = (points.ray(column, row) * f64::from(distance) * scale).as_vec3();
                let arm: Vec3 = to_world * arm;
                let place = from.view.centre + arm;
                let Some(([u, v], away)) = projector.image(place) else {
                    continue;
                };
                let seen = projector.pixel_at([u, v]);
                // Between pixels: on a slanted surface the nearest one's error is larger than the differences of
                // interest.
                let theirs = to.distances.sample(f64::from(u), f64::from(v));
                if theirs <= 0.0 || to.hides(seen) {
                    continue;
                }
                let other_arm = place - to.view.centre;
                found.push(Sighting {
                    log_ratio: (f64::from(theirs) * other_scale / f64::from(away)).ln(),
                    slope: f64::from(arm.dot(other_arm) / (away * away)),
                    pixels: [pixel, seen],
                });
            }
        }
        found
    }

    /// Returns the results of `of` for each ordered pair of views.
    pub(super) fn of_pairs<T: Send>(
        &self,
        of: impl Fn(usize, usize, Vec<Sighting>) -> T + Sync,
    ) -> Vec<T> {
        let count = self.views.len();
        let pairs: Vec<[usize; 2]> = (0..count)
            .flat_map(|first| (0..count).map(move |second| [first, second]))
            .filter(|[first, second]| first != second)
            .collect();
        self.of_some(&pairs, of)
    }

    /// Returns the results of `of` for each of some ordered pairs of views.
    pub(super) fn of_some<T: Send>(
        &self,
        pairs: &[[usize; 2]],
        of: impl Fn(usize, usize, Vec<Sighting>) -> T + Sync,
    ) -> Vec<T> {
        pairs
            .par_iter()
            .map(|&[first, second]| of(first, second, self.sightings(first, second)))
            .collect()
    }
}

/// Returns other distances of each view.
pub(super) fn with_distances(
    views: &[DistanceView<'_>],
    other: impl Fn(&DistanceView<'_>) -> DistanceImage,
) -> Vec<DistanceImage> {
    views.iter().map(other).collect()
}

/// Returns views with other distances.
pub(super) fn shown<'a>(
    views: &[DistanceView<'a>],
    distances: &'a [DistanceImage],
) -> Vec<DistanceView<'a>> {
    let views = views.iter().zip(distances);
    views
        .map(|(view, distances)| DistanceView { distances, ..*view })
        .collect()
}

/// Returns the share of places at which views disagree, from the logarithms of the ratios of their distances; `None`
/// with too few places.
pub(super) fn share_apart(log_ratios: &[f64]) -> Option<f64> {
    let apart = log_ratios.iter().filter(|&&ratio| ratio > ONE_SURFACE);
    (log_ratios.len() >= LEAST_PLACES).then(|| apart.count() as f64 / log_ratios.len() as f64)
}

impl DistanceView<'_> {
    /// Returns true if a pixel is dynamic or ignored.
    pub(crate) fn hides(&self, pixel: usize) -> bool {
        self.mask.is_some_and(|mask| mask[pixel] >= MASKED)
            || self.ignored.is_some_and(|ignored| ignored[pixel] != 0)
    }
}
