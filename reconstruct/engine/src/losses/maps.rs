//! Losses of dynamic scenes on rendered maps, in addition to [`crate::losses::photometric`]. Each adds its
//! weighted gradient to the one passed in and returns its unweighted value.
//!
//! Means are over the pixels that are not ignored ([`CountedPixels`]). Feature maps `F` are composited over 0. PVG
//! divides some by the accumulated opacity `A = 1 - T` (eps 1e-5); there `A` counts as a constant, because a
//! gradient through it would reward more opacity, not less velocity.

pub(crate) mod gpu;

/// Added to the accumulated opacity before maps are divided by it (PVG).
const OPACITY_EPSILON: f32 = 1e-5;

/// Pixels of a view that count: those not marked (non-zero) in `ignored`.
#[derive(Debug, Clone, Copy, Default)]
pub struct CountedPixels<'a> {
    /// `None` if all pixels count.
    pub ignored: Option<&'a [u8]>,
}

impl CountedPixels<'_> {
    fn counts(&self, pixel: usize) -> bool {
        self.ignored.is_none_or(|ignored| ignored[pixel] == 0)
    }

    /// Returns the number that count among `pixels`; 1 if none does, because it is a divisor of 0.
    fn of(&self, pixels: usize) -> usize {
        let counted = self.ignored.map_or(pixels, |ignored| {
            ignored.iter().filter(|&&mark| mark == 0).count()
        });
        counted.max(1)
    }
}

/// Computes the velocity regularization (Omni4DGS Eq. 9; PVG with an empty mask): mean over pixels and the
/// three planes of `|F / A| (1 - M)`, with the mask `M` in [0, 1] per pixel.
pub fn velocity_map(
    planes: &[f32],
    transmittance: &[f32],
    (mask, counted): (&[f32], CountedPixels<'_>),
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = transmittance.len();
    let values = 3 * counted.of(pixels);
    let scale = weight / values as f32;
    let mut sum = 0.0;
    for (plane, gradient) in planes
        .chunks_exact(pixels)
        .zip(gradient.chunks_exact_mut(pixels))
        .take(3)
    {
        for pixel in (0..pixels).filter(|&pixel| counted.counts(pixel)) {
            let kept = mask.get(pixel).map_or(1.0, |mask| 1.0 - mask);
            let factor = kept / (1.0 - transmittance[pixel] + OPACITY_EPSILON);
            sum += f64::from((plane[pixel] * factor).abs());
            gradient[pixel] += scale * factor * sign(plane[pixel]);
        }
    }
    sum / values as f64
}

/// Computes the lifespan loss of PVG: minus the mean of `F / A` of the lifespan's plane, which favours long
/// lifespans.
pub fn lifespan_map(
    plane: &[f32],
    transmittance: &[f32],
    counted: CountedPixels<'_>,
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = counted.of(transmittance.len());
    let scale = weight / pixels as f32;
    let mut sum = 0.0;
    let all = plane.iter().zip(transmittance).zip(gradient).enumerate();
    for (_, ((value, transmittance), gradient)) in all.filter(|(pixel, _)| counted.counts(*pixel)) {
        let factor = 1.0 / (1.0 - transmittance + OPACITY_EPSILON);
        sum += f64::from(value * factor);
        *gradient -= scale * factor;
    }
    -sum / pixels as f64
}

/// Computes the opacity loss of the dynamic Gaussians rendered alone (Omni4DGS Eq. 6): mean of `|O_d - M_d|`.
pub fn opacity_map(
    plane: &[f32],
    (mask, counted): (&[f32], CountedPixels<'_>),
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = counted.of(plane.len());
    let scale = weight / pixels as f32;
    let mut sum = 0.0;
    let all = plane.iter().zip(mask).zip(gradient).enumerate();
    for (_, ((value, mask), gradient)) in all.filter(|(pixel, _)| counted.counts(*pixel)) {
        sum += f64::from((value - mask).abs());
        *gradient += scale * sign(value - mask);
    }
    sum / pixels as f64
}

/// Returns the derivative of the absolute value, 0 at 0.
fn sign(value: f32) -> f32 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const PIXELS: usize = 12;

    fn random(len: usize, seed: u64, low: f32, high: f32) -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        (0..len).map(|_| random.random_range(low..high)).collect()
    }

    /// Compares `gradient` with differences of `value`, which is linear between its kinks.
    fn check(maps: &[f32], weight: f64, gradient: &[f32], value: impl Fn(&[f64]) -> f64) {
        let wide: Vec<f64> = maps.iter().map(|&v| f64::from(v)).collect();
        for index in 0..maps.len() {
            let shifted = |step: f64| {
                let mut shifted = wide.clone();
                shifted[index] += step;
                value(&shifted)
            };
            let expected = weight * (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            let found = f64::from(gradient[index]);
            assert!(
                (found - expected).abs() < 1e-5,
                "{index}: {found} {expected}"
            );
        }
    }

    #[test]
    fn velocity_is_penalized_outside_the_mask() {
        let (planes, left) = (
            random(3 * PIXELS, 1, -1.0, 1.0),
            random(PIXELS, 2, 0.0, 0.9),
        );
        for mask in [Vec::new(), random(PIXELS, 3, 0.0, 1.0)] {
            let reference = |planes: &[f64]| -> f64 {
                let at = |index: usize| {
                    let pixel = index % PIXELS;
                    let kept = mask.get(pixel).map_or(1.0, |&m| 1.0 - f64::from(m));
                    (planes[index] / (1.0 - f64::from(left[pixel]) + 1e-5)).abs() * kept
                };
                (0..3 * PIXELS).map(at).sum::<f64>() / (3 * PIXELS) as f64
            };
            let mut gradient = vec![0.0; 3 * PIXELS];
            let value = velocity_map(
                &planes,
                &left,
                (&mask, CountedPixels::default()),
                0.5,
                &mut gradient,
            );
            let wide: Vec<f64> = planes.iter().map(|&v| f64::from(v)).collect();
            assert!((value - reference(&wide)).abs() < 1e-5);
            check(&planes, 0.5, &gradient, reference);
        }
        let mut gradient = vec![0.0; 3 * PIXELS];
        let all = vec![1.0; PIXELS];
        assert_eq!(
            velocity_map(
                &planes,
                &left,
                (&all, CountedPixels::default()),
                0.5,
                &mut gradient
            ),
            0.0
        );
        assert_eq!(gradient, vec![0.0; 3 * PIXELS]);
    }

    #[test]
    fn where_nothing_of_the_scene_is_seen_no_map_costs_anything() {
        let (plane, mask) = (random(PIXELS, 7, 0.0, 1.0), random(PIXELS, 8, 0.0, 1.0));
        let (planes, left) = (
            random(3 * PIXELS, 9, -1.0, 1.0),
            random(PIXELS, 10, 0.0, 0.9),
        );
        let ignored: Vec<u8> = (0..PIXELS).map(|pixel| u8::from(pixel % 3 == 0)).collect();
        let counted = CountedPixels {
            ignored: Some(&ignored),
        };
        let seen: Vec<usize> = (0..PIXELS).filter(|&pixel| ignored[pixel] == 0).collect();
        let mean = |of: &dyn Fn(usize) -> f64| {
            seen.iter().map(|&pixel| of(pixel)).sum::<f64>() / seen.len() as f64
        };
        let opacity = |pixel: usize| 1.0 - f64::from(left[pixel]) + 1e-5;
        let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&v| f64::from(v)).collect() };

        let of_opacity =
            |plane: &[f64]| mean(&|pixel| (plane[pixel] - f64::from(mask[pixel])).abs());
        let mut gradient = vec![0.0; PIXELS];
        let value = opacity_map(&plane, (&mask, counted), 2.0, &mut gradient);
        assert!((value - of_opacity(&wide(&plane))).abs() < 1e-6);
        check(&plane, 2.0, &gradient, of_opacity);

        let of_lifespan = |plane: &[f64]| -mean(&|pixel| plane[pixel] / opacity(pixel));
        let mut gradient = vec![0.0; PIXELS];
        let value = lifespan_map(&plane, &left, counted, 2.0, &mut gradient);
        assert!((value - of_lifespan(&wide(&plane))).abs() < 1e-5);
        check(&plane, 2.0, &gradient, of_lifespan);

        let of_velocity = |planes: &[f64]| {
            let kept = |pixel: usize| 1.0 - f64::from(mask[pixel]);
            let of_plane = |plane: usize, pixel: usize| planes[plane * PIXELS + pixel].abs();
            mean(&|pixel| {
                let sum: f64 = (0..3).map(|plane| of_plane(plane, pixel)).sum();
                sum / 3.0 * kept(pixel) / opacity(pixel)
            })
        };
        let mut gradient = vec![0.0; 3 * PIXELS];
        let value = velocity_map(&planes, &left, (&mask, counted), 0.5, &mut gradient);
        assert!((value - of_velocity(&wide(&planes))).abs() < 1e-5);
        check(&planes, 0.5, &gradient, of_velocity);
    }

    #[test]
    fn short_lifespans_and_false_opacity_are_penalized() {
        let (plane, left) = (random(PIXELS, 4, 0.0, 1.0), random(PIXELS, 5, 0.0, 0.9));
        let mut gradient = vec![0.0; PIXELS];
        let value = lifespan_map(&plane, &left, CountedPixels::default(), 2.0, &mut gradient);
        let reference = |plane: &[f64]| -> f64 {
            let at = |(v, t): (&f64, &f32)| v / (1.0 - f64::from(*t) + 1e-5);
            -plane.iter().zip(&left).map(at).sum::<f64>() / PIXELS as f64
        };
        assert!(value < 0.0);
        check(&plane, 2.0, &gradient, reference);

        let mask = random(PIXELS, 6, 0.0, 1.0);
        let mut gradient = vec![0.0; PIXELS];
        opacity_map(
            &plane,
            (&mask, CountedPixels::default()),
            2.0,
            &mut gradient,
        );
        check(&plane, 2.0, &gradient, |plane| {
            let at = |(v, m): (&f64, &f32)| (v - f64::from(*m)).abs();
            plane.iter().zip(&mask).map(at).sum::<f64>() / PIXELS as f64
        });
        // Without dynamic Gaussians and with an empty mask, loss and gradient are 0.
        let mut gradient = vec![0.0; PIXELS];
        assert_eq!(
            opacity_map(
                &[0.0; PIXELS],
                (&[0.0; PIXELS], CountedPixels::default()),
                1.0,
                &mut gradient
            ),
            0.0
        );
        assert_eq!(gradient, [0.0; PIXELS]);
    }

    #[test]
    fn an_empty_image_has_finite_gradients() {
        let mut gradient = vec![0.0; 3 * PIXELS];
        let nothing = vec![1.0; PIXELS];
        let value = velocity_map(
            &[0.0; 3 * PIXELS],
            &nothing,
            (&[], CountedPixels::default()),
            1.0,
            &mut gradient,
        );
        assert_eq!((value, gradient.iter().all(|g| *g == 0.0)), (0.0, true));
        let mut gradient = vec![0.0; PIXELS];
        lifespan_map(
            &[0.0; PIXELS],
            &nothing,
            CountedPixels::default(),
            1.0,
            &mut gradient,
        );
        assert!(gradient.iter().all(|g| g.is_finite()));
    }
}
