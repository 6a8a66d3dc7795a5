//! Whether light changes while the clip lasts: what flat surfaces show of it.
//!
//! What neither the tone of a whole view nor the direction explains of a surface's colour, and what the next
//! view shows too, changes with time: clouds and lamps, caustics and murk under water, screens, dusk. Such a
//! scene has points everywhere that need parameters of time, masks or not. Noise of an image is not that of the
//! next one: the covariance of neighbours in time leaves it out.

use std::fmt;

use serde::Serialize;

use crate::evidence::flat_surfaces::{DirectionFit, FlatSurfaces, LEAST_SAMPLES};

/// Colours that are farther from what the direction predicts, levels of 1, are something that passes.
const LARGEST_DEVIATION: f32 = 0.1;
/// Change that lasts from one view to the next from which points everywhere keep their time, root mean square,
/// levels of 1 (docs/results/evidence.md).
const LEAST_CHANGE: f64 = 0.0055;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ChangingLight {
    /// Surfaces in pairs of neighbouring views, channel by channel.
    pub samples: usize,
    /// Square root of the covariance of neighbours in time, levels of 1; 0 where it is negative.
    pub change: f64,
}

impl ChangingLight {
    /// Evidence from the colours of flat surfaces.
    pub(super) fn of(flat: &FlatSurfaces) -> Self {
        let (mut samples, mut products) = (0, 0.0);
        for views in &flat.surfaces {
            let fit = DirectionFit::of(views.iter(), flat.noise);
            let mut deviations: Vec<[f32; 3]> = views
                .iter()
                .map(|seen| {
                    let predicted = fit.at(seen.direction);
                    [0, 1, 2].map(|channel| {
                        let deviation = seen.colour[channel] - predicted[channel];
                        deviation.clamp(-LARGEST_DEVIATION, LARGEST_DEVIATION)
                    })
                })
                .collect();
            let count = deviations.len().max(1) as f32;
            let mean = [0, 1, 2].map(|channel| {
                let sum: f32 = deviations.iter().map(|deviation| deviation[channel]).sum();
                sum / count
            });
            for deviation in &mut deviations {
                *deviation = [0, 1, 2].map(|channel| deviation[channel] - mean[channel]);
            }
            for pair in deviations.windows(2) {
                samples += 3;
                let product = |channel: usize| f64::from(pair[0][channel] * pair[1][channel]);
                products += [0, 1, 2].map(product).iter().sum::<f64>();
            }
        }
        Self {
            samples,
            change: (products.max(0.0) / samples.max(1) as f64).sqrt(),
        }
    }

    /// Whether points everywhere may need parameters of time. Where too little is seen to tell, they may.
    pub fn is_everywhere(&self) -> bool {
        self.samples < LEAST_SAMPLES || self.change >= LEAST_CHANGE
    }
}

impl fmt::Display for ChangingLight {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.samples < LEAST_SAMPLES {
            return out.write_str(
                "too few flat surfaces are seen by enough views to tell whether light changes",
            );
        }
        write!(
            out,
            "at {} samples of flat surfaces changes last from one view to the next that neither whole \
             views nor directions explain, {:.4}, root mean square in levels of 1 (limit {LEAST_CHANGE})",
            self.samples, self.change
        )
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::evidence::flat_surfaces::Observation;

    /// Surfaces beside a path of 20 cameras with noise of 0.01, and light of their own over time.
    fn surfaces(light: impl Fn(usize, usize) -> f32) -> FlatSurfaces {
        let surface = |number: usize| {
            let at = Vec3::new(0.7 * (number % 9) as f32 - 3.0, 1.0, 2.0);
            let view = |view: usize| {
                let direction = (at - Vec3::new(0.2 * view as f32 - 2.0, 0.0, 0.0)).normalize();
                let noise = 0.017 * (((view * 7 + number * 13) % 23) as f32 / 11.0 - 1.0);
                let own = 0.1 * (number % 5) as f32 + 0.05 * direction.x;
                Observation {
                    view,
                    direction,
                    colour: [own + noise + light(number, view); 3],
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

    #[test]
    fn where_little_is_seen_it_may_change() {
        let nothing = ChangingLight::of(&FlatSurfaces::default());
        assert!(nothing.is_everywhere() && nothing.to_string().contains("too few"));
    }
}
