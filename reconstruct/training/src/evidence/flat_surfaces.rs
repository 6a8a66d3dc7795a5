//! Colours of flat surfaces in the views that see them.
//!
//! Around a flat surface every view shows nearly one colour, so that neither parallax nor the blur of a pilot fit
//! plays a part. A difference of its colour between views comes from the light, the surface or the camera.
//! Changes of a view that all surfaces of a colour share are removed: an exposure that is not quite a gain, light
//! that changes everywhere.

use std::collections::BTreeMap;

use glam::{Mat3, Vec3};
use omnilife_schemas::statistics::median;

/// Maximum difference of the colours in a window of a flat surface, levels of 1.
pub(super) const FLAT: f32 = 0.1;
/// Minimum number of views of a surface for a fit and a test.
pub(super) const LEAST_VIEWS: usize = 6;
/// Minimum number of samples.
pub(super) const LEAST_SAMPLES: usize = 1_000;
/// Rounds of the robust fit of a view's tones; changes of this many medians have half their weight.
const TONE_ROUNDS: usize = 5;
const TONE_REACH: f32 = 3.0;
/// Minimum variance of levels for a slope.
const TONE_RIDGE: f64 = 1e-4;
/// Slopes of this size, levels of 1 per unit of direction, are as plausible as 0.
const PLAUSIBLE_SLOPE: f32 = 0.3;

/// A surface in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observation {
    pub(super) view: usize,
    /// Unit direction from the camera to the surface, world frame.
    pub(super) direction: Vec3,
    /// Levels of 1.
    pub(super) colour: [f32; 3],
}

/// Flat surfaces, each with the views that see it, in the order of time; tones of views are removed.
#[derive(Debug, Default)]
pub(super) struct FlatSurfaces {
    pub(super) surfaces: Vec<Vec<Observation>>,
    /// Variance of a colour around the mean of its surface: the median.
    pub(super) noise: f32,
    /// Median level of the surfaces, of all channels.
    pub(super) level: f32,
}

impl FlatSurfaces {
    /// Returns all surfaces that enough views see.
    pub(super) fn of(mut surfaces: Vec<Vec<Observation>>) -> Self {
        surfaces.retain(|views| views.len() >= LEAST_VIEWS);
        subtract_tones(&mut surfaces);
        Self {
            noise: median_square(surfaces.iter()),
            level: median_level(&surfaces),
            surfaces,
        }
    }
}

/// Removes from every view the change that all surfaces of a colour share: an exposure that is not quite a gain,
/// light that changes. For each view and channel it is an affine function of the surfaces' mean colours.
fn subtract_tones(surfaces: &mut [Vec<Observation>]) {
    let means: Vec<[f32; 3]> = surfaces
        .iter()
        .map(|views| {
            let sum = |channel: usize| views.iter().map(|seen| seen.colour[channel]).sum::<f32>();
            [0, 1, 2].map(|channel| sum(channel) / views.len().max(1) as f32)
        })
        .collect();
    let mut of_views: BTreeMap<usize, Vec<(&[f32; 3], &mut Observation)>> = BTreeMap::new();
    for (views, mean) in surfaces.iter_mut().zip(&means) {
        for seen in views {
            of_views.entry(seen.view).or_default().push((mean, seen));
        }
    }
    for seen in of_views.values_mut() {
        for channel in 0..3 {
            let change = |mean: &[f32; 3], seen: &Observation| seen.colour[channel] - mean[channel];
            let pairs: Vec<(f32, f32)> = seen
                .iter()
                .map(|(mean, seen)| (mean[channel], change(mean, seen)))
                .collect();
            let tone = Tone::of(&pairs);
            for (mean, seen) in seen.iter_mut() {
                seen.colour[channel] -= tone.at(mean[channel]);
            }
        }
    }
}

/// An affine function of a level.
#[derive(Debug, Clone, Copy, Default)]
struct Tone {
    offset: f32,
    slope: f32,
}

impl Tone {
    /// Fits robust least squares: outliers have little weight.
    fn of(pairs: &[(f32, f32)]) -> Self {
        let mut tone = Self::default();
        for _ in 0..TONE_ROUNDS {
            let left = |&(level, change): &(f32, f32)| change - tone.at(level);
            let sizes: Vec<f32> = pairs.iter().map(|pair| left(pair).abs()).collect();
            let scale = TONE_REACH * median(&sizes).unwrap_or_default().max(f32::MIN_POSITIVE);
            let weighted = pairs.iter().map(|pair| {
                let weight = 1.0 / (1.0 + (left(pair) / scale).powi(2));
                (f64::from(weight), f64::from(pair.0), f64::from(pair.1))
            });
            let [mut weights, mut x, mut y, mut xx, mut xy] = [0.0; 5];
            for (weight, level, change) in weighted {
                weights += weight;
                x += weight * level;
                y += weight * change;
                xx += weight * level * level;
                xy += weight * level * change;
            }
            // Equal levels have no slope.
            let spread = xx * weights - x * x + TONE_RIDGE * weights * weights;
            if weights <= 0.0 {
                return Self::default();
            }
            let slope = (xy * weights - x * y) / spread;
            tone = Self {
                offset: ((y - slope * x) / weights) as f32,
                slope: slope as f32,
            };
        }
        tone
    }

    fn at(&self, level: f32) -> f32 {
        self.offset + self.slope * level
    }
}

/// Colours as a linear function of the direction.
#[derive(Debug)]
pub(super) struct DirectionFit {
    direction: Vec3,
    /// The mean.
    pub(super) colour: [f32; 3],
    slopes: [Vec3; 3],
    /// Number of observations, at least 1.
    count: f32,
    /// Inverse of the matrix of squared directions, prior included.
    inverse: Mat3,
}

impl DirectionFit {
    /// Fits least squares with slopes drawn to 0; `noise` is the variance of a colour.
    pub(super) fn of<'a>(views: impl Iterator<Item = &'a Observation> + Clone, noise: f32) -> Self {
        let count = views.clone().count().max(1) as f32;
        let direction = views.clone().map(|seen| seen.direction).sum::<Vec3>() / count;
        let mean = |channel: usize| {
            let colours = views.clone().map(|seen| seen.colour[channel]);
            colours.sum::<f32>() / count
        };
        let colour = [0, 1, 2].map(mean);
        let prior = (noise / (PLAUSIBLE_SLOPE * PLAUSIBLE_SLOPE)).max(f32::MIN_POSITIVE);
        let mut squares = Mat3::from_diagonal(Vec3::splat(prior));
        let mut products = [Vec3::ZERO; 3];
        for seen in views {
            let offset = seen.direction - direction;
            squares += Mat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
            for channel in 0..3 {
                products[channel] += offset * (seen.colour[channel] - colour[channel]);
            }
        }
        let inverse = squares.inverse();
        // Singular if both directions and noise vanish.
        let inverse = if inverse.is_finite() {
            inverse
        } else {
            Mat3::ZERO
        };
        Self {
            direction,
            colour,
            slopes: products.map(|product| inverse * product),
            count,
            inverse,
        }
    }

    /// Returns the weight of the colour observed in one direction in the fit's prediction for another: an element
    /// of its hat matrix.
    pub(super) fn leverage(&self, predicted: Vec3, observed: Vec3) -> f32 {
        let [predicted, observed] = [predicted, observed].map(|one| one - self.direction);
        1.0 / self.count + predicted.dot(self.inverse * observed)
    }

    pub(super) fn at(&self, direction: Vec3) -> [f32; 3] {
        let offset = direction - self.direction;
        [0, 1, 2].map(|channel| self.colour[channel] + self.slopes[channel].dot(offset))
    }
}

fn median_level(surfaces: &[Vec<Observation>]) -> f32 {
    let levels = surfaces.iter().flatten().flat_map(|seen| seen.colour);
    median(&levels.collect::<Vec<f32>>()).unwrap_or_default()
}

/// Returns the median square of the colours around the mean of their surface.
fn median_square<'a>(surfaces: impl Iterator<Item = &'a Vec<Observation>>) -> f32 {
    let mut squares = Vec::new();
    for views in surfaces {
        for channel in 0..3 {
            let sum: f32 = views.iter().map(|seen| seen.colour[channel]).sum();
            let mean = sum / views.len() as f32;
            let errors = views.iter().map(|seen| seen.colour[channel] - mean);
            squares.extend(errors.map(|error| error * error));
        }
    }
    median(&squares).unwrap_or_default()
}
