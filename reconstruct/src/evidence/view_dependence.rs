//! Whether colours depend on the direction from which they are seen.
//!
//! Residuals of a pilot fit always do: what it blurs shows another neighbour from another
//! side, and harmonics on its Gaussians predict views that were left out better in scenes without
//! any gloss. So the question is put to the images, where neighbours do not matter: at surfaces around
//! which every view shows next to one colour. Each surface's colours are fitted by a linear function of
//! the viewing direction - spherical harmonics of degree 1 - from every other view that shows it, and
//! predicted in the rest. What the fit predicts better than the mean of the same views depends on the
//! direction; noise and what passes for a view or two is predicted worse. (Light that changes slowly
//! while the camera passes looks the same.)

use std::{collections::BTreeMap, fmt};

use glam::{Mat3, Vec3};
use omnilife_schemas::statistics::median;
use serde::Serialize;

/// Degree of the harmonics that this is evidence for.
pub const SH_DEGREE: usize = 1;
/// A surface is flat where the colours of a window differ by less than this, levels of 1.
pub const FLAT: f32 = 0.1;
/// Surfaces seen by fewer views have nothing to fit and to test.
const LEAST_VIEWS: usize = 6;
/// Fewer samples tell nothing.
const LEAST_SAMPLES: usize = 1_000;
/// Squared errors count up to this many times their median over all surfaces: what moves is not to
/// decide.
const LARGEST_OVER_MEDIAN: f32 = 25.0;
/// Rounds of the robust fit of a view's tones; changes of this many medians have half their weight.
const TONE_ROUNDS: usize = 5;
const TONE_REACH: f32 = 3.0;
/// Variance of levels below which there is no slope to speak of.
const TONE_RIDGE: f64 = 1e-4;
/// Slopes of this size, levels of 1 per unit of direction, are as plausible as none.
const PLAUSIBLE_SLOPE: f32 = 0.3;
/// Change of colours with the direction from which harmonics are worth their memory: root mean square,
/// levels of 1; three grey levels of 256. Renders without gloss have up to 0.005, real footage has 0.033
/// and more (docs/results/dynamic.md).
const LEAST_CHANGE: f64 = 0.012;

/// A surface in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Number of the view.
    pub view: usize,
    /// From the camera to the surface, world frame, unit.
    pub direction: Vec3,
    /// Levels of 1.
    pub colour: [f32; 3],
}

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ViewDependence {
    /// Surfaces in views that were predicted, channel by channel.
    pub samples: usize,
    /// Root mean square of what directions predict of the colours, levels of 1.
    pub change: f64,
}

impl ViewDependence {
    /// Evidence from surfaces, each with the views in which it is seen, in the order of time.
    pub fn of(mut surfaces: Vec<Vec<Observation>>) -> Self {
        surfaces.retain(|views| views.len() >= LEAST_VIEWS);
        subtract_tones(&mut surfaces);
        let usable = || surfaces.iter();
        let noise = median_square(usable());
        let largest = LARGEST_OVER_MEDIAN * noise;
        let square = |error: f32| f64::from((error * error).min(largest));
        let (mut samples, mut predicted) = (0, 0.0);
        for views in usable() {
            for fold in 0..2 {
                let of_fold = |is_tested: bool| {
                    let numbered = views.iter().enumerate();
                    let chosen = numbered.filter(move |(view, _)| (view % 2 == fold) == is_tested);
                    chosen.map(|(_, seen)| seen)
                };
                let fit = Fit::of(of_fold(false), noise);
                for seen in of_fold(true) {
                    let by_direction = fit.at(seen.direction);
                    let by_mean = fit.colour.iter().zip(&by_direction);
                    for (colour, (mean, predicted_colour)) in seen.colour.iter().zip(by_mean) {
                        samples += 1;
                        predicted += square(colour - mean) - square(colour - predicted_colour);
                    }
                }
            }
        }
        Self {
            samples,
            change: (predicted.max(0.0) / samples.max(1) as f64).sqrt(),
        }
    }

    /// Whether colours depend on the direction enough to be worth harmonics.
    pub fn is_worth_harmonics(&self) -> bool {
        self.samples >= LEAST_SAMPLES && self.change >= LEAST_CHANGE
    }
}

impl fmt::Display for ViewDependence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.samples < LEAST_SAMPLES {
            return out.write_str(
                "too few flat surfaces are seen by enough views to tell whether colours depend on the \
                 direction",
            );
        }
        write!(
            out,
            "at {} samples of flat surfaces directions predict changes of {:.4}, root mean square in \
             levels of 1 (limit {LEAST_CHANGE})",
            self.samples, self.change
        )
    }
}

/// Takes out of every view what changes all surfaces of a colour alike: an exposure that is not quite a gain,
/// light that changes. For each view and channel that is an affine function of the surfaces' mean colours.
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
    /// Robust least squares: what is far from the others has little say.
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
            // Levels that are all alike have no slope.
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
struct Fit {
    direction: Vec3,
    colour: [f32; 3],
    slopes: [Vec3; 3],
}

impl Fit {
    /// Least squares with slopes drawn to 0; `noise` is the variance of a colour.
    fn of<'a>(views: impl Iterator<Item = &'a Observation> + Clone, noise: f32) -> Self {
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
        let slopes = products.map(|product| inverse * product);
        Self {
            direction,
            colour,
            // Where neither directions nor noise leave anything to divide by.
            slopes: slopes.map(|slope| if slope.is_finite() { slope } else { Vec3::ZERO }),
        }
    }

    fn at(&self, direction: Vec3) -> [f32; 3] {
        let offset = direction - self.direction;
        [0, 1, 2].map(|channel| self.colour[channel] + self.slopes[channel].dot(offset))
    }
}

/// Median square of the colours around the mean of their surface.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Surfaces beside a path of 20 cameras, with noise, and with a gloss of this slope, which brightens every
    /// other one towards the one side.
    fn surfaces(slope: f32) -> Vec<Vec<Observation>> {
        let surface = |number: usize| {
            let at = Vec3::new(0.7 * (number % 9) as f32 - 3.0, 1.0, 2.0);
            let view = |view: usize| {
                let direction = (at - Vec3::new(0.2 * view as f32 - 2.0, 0.0, 0.0)).normalize();
                let noise = 0.02 * (((view * 7 + number * 3) % 11) as f32 / 5.0 - 1.0);
                // Something passes for a view.
                let passing = if view == number % 370 { 0.5 } else { 0.0 };
                let own = 0.1 * (number % 5) as f32;
                let slope = if (number / 5).is_multiple_of(2) {
                    slope
                } else {
                    -slope
                };
                Observation {
                    view,
                    direction,
                    colour: [own + slope * direction.x + noise + passing; 3],
                }
            };
            (0..20).map(view).collect()
        };
        (0..300).map(surface).collect()
    }

    #[test]
    fn gloss_is_told_from_noise_and_from_what_passes() {
        let [none, little, gloss] =
            [0.0, 0.01, 0.1].map(|slope| ViewDependence::of(surfaces(slope)));
        assert_eq!(none.samples, 300 * 20 * 3);
        assert!(
            none.change < 0.002 && !none.is_worth_harmonics(),
            "{none:?}"
        );
        assert!(!little.is_worth_harmonics(), "{little:?}");
        // Directions deviate by 0.37 from their mean along the path.
        assert!((gloss.change - 0.037).abs() < 0.01, "{gloss:?}");
        assert!(gloss.is_worth_harmonics() && gloss.to_string().contains("limit 0.012"));
    }

    #[test]
    fn what_changes_a_whole_view_is_no_gloss() {
        // A tone curve that goes on changing while the camera passes, as the direction does.
        let mut surfaces = surfaces(0.0);
        for seen in surfaces.iter_mut().flatten() {
            let share = 0.01 * (seen.view as f32 - 10.0);
            seen.colour = seen.colour.map(|level| level * (1.0 + share) + 0.2 * share);
        }
        let found = ViewDependence::of(surfaces);
        assert!(found.change < 0.003, "{found:?}");
    }

    #[test]
    fn without_views_nothing_is_known() {
        let few: Vec<Vec<Observation>> = surfaces(0.1)
            .into_iter()
            .map(|views| views[..LEAST_VIEWS - 1].to_vec())
            .collect();
        for nothing in [ViewDependence::of(few), ViewDependence::of(Vec::new())] {
            assert_eq!(nothing, ViewDependence::default());
            assert!(!nothing.is_worth_harmonics() && nothing.to_string().contains("too few"));
        }
        // Far away the direction never changes, and nothing else does: nothing to divide by.
        let seen = Observation {
            view: 0,
            direction: Vec3::Z,
            colour: [0.1; 3],
        };
        assert_eq!(ViewDependence::of(vec![vec![seen; 8]; 50]).change, 0.0);
    }
}
