//! Changes of light during the clip, measured on flat surfaces.
//!
//! The colour of a surface may deviate from the tone of its view and the viewing direction. If the next view
//! shows the same deviation, the light changes with time: clouds and lamps, caustics and murk under water,
//! screens, dusk. Such a scene has points everywhere that need parameters of time, with or without masks. Image
//! noise differs from view to view: the covariance of neighbours in time excludes it.

use std::fmt;

use serde::Serialize;

use crate::evidence::{
    flat_surfaces::{DirectionFit, FlatSurfaces, Observation},
    share_of_limits,
};

/// Maximum deviation of colours from the direction's prediction, levels of 1 by day; larger ones are passing objects.
const LARGEST_DEVIATION: f32 = 0.1;
/// Minimum change that lasts from one view to the next for which points everywhere keep their time, root mean
/// square, levels of 1 by day (docs/results/evidence.md).
const LEAST_CHANGE: f64 = 0.008;
/// Standard errors by which the covariance has to lie below that of [`LEAST_CHANGE`] for constant light: one clip
/// in 160 by chance.
const STANDARD_ERRORS: f64 = 2.5;
/// Minimum number of surfaces for a standard error of their mean.
const LEAST_SURFACES: usize = 10;

/// Evidence of changing light.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ChangingLight {
    /// Surfaces in pairs of neighbouring views, channel by channel.
    pub samples: usize,
    /// Square root of the covariance of neighbours in time, levels of 1; 0 where it is negative.
    pub change: f64,
    /// Largest change that the samples allow, levels of 1: 2.5 standard errors above. `None` where too few
    /// surfaces are visible for a spread.
    pub largest_change: Option<f64>,
    /// Minimum change for which points everywhere keep their time, levels of 1: in proportion to those of dark scenes.
    pub limit: f64,
}

impl ChangingLight {
    /// Measures the evidence on the colours of flat surfaces.
    pub(super) fn of(flat: &FlatSurfaces) -> Self {
        let products: Vec<Products> = flat
            .surfaces
            .iter()
            .map(|views| Products::of(views, flat))
            .collect();
        let samples: usize = products.iter().map(|of_one| of_one.samples).sum();
        let sum: f64 = products.iter().map(|of_one| of_one.sum).sum();
        let covariance = sum / samples.max(1) as f64;
        // Views and channels of one surface depend on each other: the surfaces are the samples.
        let squares = products.iter().map(|of_one| {
            let expected = covariance * of_one.samples as f64;
            (of_one.sum - expected).powi(2)
        });
        let standard_error = squares.sum::<f64>().sqrt() / samples.max(1) as f64;
        let largest = covariance + STANDARD_ERRORS * standard_error;
        Self {
            samples,
            change: covariance.max(0.0).sqrt(),
            largest_change: (products.len() >= LEAST_SURFACES).then(|| largest.max(0.0).sqrt()),
            limit: LEAST_CHANGE * f64::from(share_of_limits(flat.level)),
        }
    }

    /// Returns true if light certainly changes.
    pub fn is_seen(&self) -> bool {
        self.largest_change.is_some() && self.change >= self.limit
    }

    /// Returns true if points everywhere may need parameters of time, also without enough evidence.
    pub fn is_everywhere(&self) -> bool {
        self.largest_change
            .is_none_or(|largest| largest >= self.limit)
    }
}

/// Products of deviations in neighbouring views of one surface: on average 0 if only noise differs.
struct Products {
    samples: usize,
    sum: f64,
}

impl Products {
    /// Returns the products of deviations from the predictions by direction.
    fn of(views: &[Observation], flat: &FlatSurfaces) -> Self {
        let fit = DirectionFit::of(views.iter(), flat.noise);
        let largest = LARGEST_DEVIATION * share_of_limits(flat.level);
        let deviations: Vec<[f32; 3]> = views
            .iter()
            .map(|seen| {
                let predicted = fit.at(seen.direction);
                [0, 1, 2].map(|channel| {
                    let deviation = seen.colour[channel] - predicted[channel];
                    deviation.clamp(-largest, largest)
                })
            })
            .collect();
        let leverage =
            |of: usize, with: usize| fit.leverage(views[of].direction, views[with].direction);
        // The fit absorbs a part of each view, so that neighbours of pure noise differ: E[d_i d_j] = -H_ij *
        // variance.
        let taken: f32 = (1..views.len()).map(|of| leverage(of - 1, of)).sum();
        let left = views.len() as f32 - (0..views.len()).map(|of| leverage(of, of)).sum::<f32>();
        let (mut samples, mut sum) = (0, 0.0);
        for channel in 0..3 {
            let own = |of: &[f32; 3]| f64::from(of[channel]);
            let squares: f64 = deviations.iter().map(|of| own(of).powi(2)).sum();
            let neighbours = deviations.windows(2);
            let products: f64 = neighbours.map(|pair| own(&pair[0]) * own(&pair[1])).sum();
            samples += deviations.len().saturating_sub(1);
            sum += products + f64::from(taken) * squares / f64::from(left.max(1.0));
        }
        Self { samples, sum }
    }
}

impl fmt::Display for ChangingLight {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(largest) = self.largest_change else {
            return out.write_str(
                "too few flat surfaces are seen by enough views to tell whether light changes",
            );
        };
        write!(
            out,
            "at {} samples of flat surfaces changes last from one view to the next that neither whole \
             views nor directions explain, {:.4}, at most {largest:.4}, root mean square in levels of 1 \
             (limit {:.4})",
            self.samples, self.change, self.limit
        )
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Returns surfaces beside a path of 20 cameras with noise of 0.01, and light of their own over time.
    fn surfaces(light: impl Fn(usize, usize) -> f32) -> FlatSurfaces {
        surfaces_at(1.0, light)
    }

    /// Returns the same at this share of the brightness.
    fn surfaces_at(brightness: f32, light: impl Fn(usize, usize) -> f32) -> FlatSurfaces {
        let surface = |number: usize| {
            let at = Vec3::new(0.7 * (number % 9) as f32 - 3.0, 1.0, 2.0);
            let view = |view: usize| {
                let direction = (at - Vec3::new(0.2 * view as f32 - 2.0, 0.0, 0.0)).normalize();
                let noise = 0.017 * (((view * 7 + number * 13) % 23) as f32 / 11.0 - 1.0);
                let own = 0.2 + 0.1 * (number % 5) as f32 + 0.05 * direction.x;
                Observation {
                    view,
                    direction,
                    colour: [brightness * (own + noise + light(number, view)); 3],
                }
            };
            (0..20).map(view).collect()
        };
        FlatSurfaces::of((0..300).map(surface).collect())
    }

    #[test]
    fn light_that_changes_is_told_from_noise_gloss_and_what_passes() {
        let noise = ChangingLight::of(&surfaces(|_, _| 0.0));
        assert!(
            noise.samples == 300 * 19 * 3 && !noise.is_everywhere(),
            "{noise}"
        );
        let passing = surfaces(|surface, view| if view == surface % 370 { 0.5 } else { 0.0 });
        let passing = ChangingLight::of(&passing);
        assert!(!passing.is_everywhere(), "{passing}");
        // Waves of caustics, another phase at every surface.
        let caustics =
            |surface: usize, view: usize| 0.04 * (0.9 * view as f32 + surface as f32).sin();
        let caustics = ChangingLight::of(&surfaces(caustics));
        assert!(
            caustics.change > 0.02 && caustics.is_everywhere(),
            "{caustics}"
        );
    }

    /// Checks levels around 0.05: what is changing light by day is so by night.
    #[test]
    fn light_that_changes_is_found_at_night() {
        let caustics =
            |surface: usize, view: usize| 0.04 * (0.9 * view as f32 + surface as f32).sin();
        let by_day = ChangingLight::of(&surfaces(caustics));
        let by_night = ChangingLight::of(&surfaces_at(0.125, caustics));
        assert!(by_day.is_seen() && by_day.limit == LEAST_CHANGE, "{by_day}");
        assert!(by_night.is_seen() && by_night.is_everywhere(), "{by_night}");
        assert!(by_night.change < LEAST_CHANGE, "{by_night}");
        assert!(
            (by_night.change / by_day.change - 0.125).abs() < 0.02,
            "{by_night}"
        );
        let noise = ChangingLight::of(&surfaces_at(0.125, |_, _| 0.0));
        assert!(!noise.is_everywhere() && !noise.is_seen(), "{noise}");
    }

    /// Checks that a fit to six or eight views absorbs so much of their noise that the residuals of neighbours
    /// differ.
    #[test]
    fn noise_in_few_views_is_neither_change_nor_the_opposite() {
        let few = |views: usize, light: f32| {
            let mut all =
                surfaces(|surface, view| light * (0.9 * view as f32 + surface as f32).sin())
                    .surfaces;
            for of_one in &mut all {
                of_one.truncate(views);
            }
            ChangingLight::of(&FlatSurfaces::of(all))
        };
        for views in [6, 8, 20] {
            let noise = few(views, 0.0);
            assert!(!noise.is_everywhere() && noise.change < 0.003, "{noise}");
            let lit = few(views, 0.04);
            assert!(lit.change > 0.015, "{lit}");
        }
    }

    #[test]
    fn where_little_is_seen_it_may_change() {
        let nothing = ChangingLight::of(&FlatSurfaces::default());
        assert!(nothing.is_everywhere() && nothing.to_string().contains("too few"));
    }
}
