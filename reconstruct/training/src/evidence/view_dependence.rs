//! Dependence of colours on the viewing direction.
//!
//! Residuals of a pilot fit always depend on it: a blurred point shows another neighbour from another side.
//! Harmonics on its Gaussians predicted left-out views better even in scenes without any gloss. So the measure
//! uses the images at flat surfaces (`flat_surfaces.rs`), where neighbours do not matter. Each surface's colours
//! are fitted by a linear function of the viewing direction - spherical harmonics of degree 1 - from every other
//! view that shows it, and predicted in the rest. A better prediction than the mean of the same views comes from
//! the direction; noise, and objects that pass for a view or two, are predicted worse. (Light that changes slowly
//! while the camera passes looks the same.)

use std::fmt;

use serde::Serialize;

use crate::evidence::flat_surfaces::{DirectionFit, FlatSurfaces, LEAST_SAMPLES};

/// Degree of the harmonics of this evidence.
pub const SH_DEGREE: usize = 1;
/// Maximum of squared errors in multiples of their median over all surfaces: moving objects must not decide.
const LARGEST_OVER_MEDIAN: f32 = 25.0;
/// Minimum change of colours with the direction for harmonics: root mean square, levels of 1; six grey levels of
/// 256. Renders without gloss have up to 0.005, real footage has 0.033 and more (docs/results/dynamic.md). Rendered
/// clips of 0.012 and more lost 0.03 dB and 7 % of the time with harmonics (docs/results/evidence.md, rules).
const LEAST_CHANGE: f64 = 0.024;

/// Evidence of view dependence.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ViewDependence {
    /// Predicted surfaces in views, channel by channel.
    pub samples: usize,
    /// Root mean square of the predicted part of the colours, levels of 1.
    pub change: f64,
}

impl ViewDependence {
    /// Measures the evidence on the colours of flat surfaces.
    pub(super) fn of(flat: &FlatSurfaces) -> Self {
        let largest = LARGEST_OVER_MEDIAN * flat.noise;
        let square = |error: f32| f64::from((error * error).min(largest));
        let (mut samples, mut predicted) = (0, 0.0);
        for views in &flat.surfaces {
            for fold in 0..2 {
                let of_fold = |is_tested: bool| {
                    let numbered = views.iter().enumerate();
                    let chosen = numbered.filter(move |(view, _)| (view % 2 == fold) == is_tested);
                    chosen.map(|(_, seen)| seen)
                };
                let fit = DirectionFit::of(of_fold(false), flat.noise);
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

    /// Returns true if colours depend on the direction enough for harmonics.
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::evidence::flat_surfaces::{LEAST_VIEWS, Observation};

    /// Returns surfaces beside a path of 20 cameras, with noise, and with a gloss of this slope, which brightens
    /// every other one towards the one side.
    fn surfaces(slope: f32) -> Vec<Vec<Observation>> {
        let surface = |number: usize| {
            let at = Vec3::new(0.7 * (number % 9) as f32 - 3.0, 1.0, 2.0);
            let view = |view: usize| {
                let direction = (at - Vec3::new(0.2 * view as f32 - 2.0, 0.0, 0.0)).normalize();
                let noise = 0.02 * (((view * 7 + number * 3) % 11) as f32 / 5.0 - 1.0);
                // An object passes for a view.
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
            [0.0, 0.01, 0.1].map(|slope| ViewDependence::of(&FlatSurfaces::of(surfaces(slope))));
        assert_eq!(none.samples, 300 * 20 * 3);
        assert!(
            none.change < 0.002 && !none.is_worth_harmonics(),
            "{none:?}"
        );
        assert!(!little.is_worth_harmonics(), "{little:?}");
        // Directions deviate by 0.37 from their mean along the path.
        assert!((gloss.change - 0.037).abs() < 0.01, "{gloss:?}");
        assert!(gloss.is_worth_harmonics() && gloss.to_string().contains("limit 0.024"));
    }

    #[test]
    fn what_changes_a_whole_view_is_no_gloss() {
        // A tone curve that changes while the camera passes, as the direction does.
        let mut surfaces = surfaces(0.0);
        for seen in surfaces.iter_mut().flatten() {
            let share = 0.01 * (seen.view as f32 - 10.0);
            seen.colour = seen.colour.map(|level| level * (1.0 + share) + 0.2 * share);
        }
        let found = ViewDependence::of(&FlatSurfaces::of(surfaces));
        assert!(found.change < 0.003, "{found:?}");
    }

    #[test]
    fn without_views_nothing_is_known() {
        let few: Vec<Vec<Observation>> = surfaces(0.1)
            .into_iter()
            .map(|views| views[..LEAST_VIEWS - 1].to_vec())
            .collect();
        for nothing in [few, Vec::new()] {
            let nothing = ViewDependence::of(&FlatSurfaces::of(nothing));
            assert_eq!(nothing, ViewDependence::default());
            assert!(!nothing.is_worth_harmonics() && nothing.to_string().contains("too few"));
        }
        // Far away the direction is constant, and all else too: the divisor is 0.
        let seen = Observation {
            view: 0,
            direction: Vec3::Z,
            colour: [0.1; 3],
        };
        let far = FlatSurfaces::of(vec![vec![seen; 8]; 50]);
        assert_eq!(ViewDependence::of(&far).change, 0.0);
    }
}
