//! Losses of dynamic scenes beside the photometric one of [`crate::losses::photometric`]; each adds its
//! gradient, times its weight, to what it is given and returns its unweighted value.
//!
//! Images have `n` pixels. Feature maps `F` are composited over 0; where PVG divides them by the
//! accumulated opacity `A = 1 - T` (eps 1e-5), `A` counts as a constant: a gradient through it would
//! pay for more opacity, not for less velocity.

pub(crate) mod gpu;

/// Added to the accumulated opacity before maps are divided by it (PVG).
const OPACITY_EPSILON: f32 = 1e-5;

/// Velocity regularization (Omni4DGS Eq. 9; PVG with an empty mask): mean over pixels and the three
/// planes of `|F / A| (1 - M)`.
pub fn velocity_map(
    planes: &[f32],
    transmittance: &[f32],
    mask: &[f32],
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = transmittance.len();
    let scale = weight / (3 * pixels) as f32;
    let mut sum = 0.0;
    for (plane, gradient) in planes
        .chunks_exact(pixels)
        .zip(gradient.chunks_exact_mut(pixels))
        .take(3)
    {
        for pixel in 0..pixels {
            let kept = mask.get(pixel).map_or(1.0, |mask| 1.0 - mask);
            let factor = kept / (1.0 - transmittance[pixel] + OPACITY_EPSILON);
            sum += f64::from((plane[pixel] * factor).abs());
            gradient[pixel] += scale * factor * sign(plane[pixel]);
        }
    }
    sum / (3 * pixels) as f64
}

/// Lifespan loss of PVG: minus the mean of `F / A` of the lifespan's plane, so that Gaussians live
/// long.
pub fn lifespan_map(
    plane: &[f32],
    transmittance: &[f32],
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = transmittance.len();
    let scale = weight / pixels as f32;
    let mut sum = 0.0;
    for ((value, transmittance), gradient) in plane.iter().zip(transmittance).zip(gradient) {
        let factor = 1.0 / (1.0 - transmittance + OPACITY_EPSILON);
        sum += f64::from(value * factor);
        *gradient -= scale * factor;
    }
    -sum / pixels as f64
}

/// Opacity loss of the dynamic Gaussians rendered alone (Omni4DGS Eq. 6): mean of `|O_d - M_d|`, to which
/// the pixels that `ignored` marks (not zero) add nothing.
pub fn opacity_map(
    plane: &[f32],
    mask: &[f32],
    ignored: Option<&[u8]>,
    weight: f32,
    gradient: &mut [f32],
) -> f64 {
    let scale = weight / plane.len() as f32;
    let mut sum = 0.0;
    let pixels = plane.iter().zip(mask).zip(gradient).enumerate();
    for (pixel, ((value, mask), gradient)) in pixels {
        if ignored.is_some_and(|ignored| ignored[pixel] != 0) {
            continue;
        }
        sum += f64::from((value - mask).abs());
        *gradient += scale * sign(value - mask);
    }
    sum / plane.len() as f64
}

/// The derivative of the absolute value, 0 at 0.
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

    /// Holds `gradient` against differences of `value`, which is linear between its kinks.
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
            let value = velocity_map(&planes, &left, &mask, 0.5, &mut gradient);
            let wide: Vec<f64> = planes.iter().map(|&v| f64::from(v)).collect();
            assert!((value - reference(&wide)).abs() < 1e-5);
            check(&planes, 0.5, &gradient, reference);
        }
        let mut gradient = vec![0.0; 3 * PIXELS];
        let all = vec![1.0; PIXELS];
        assert_eq!(velocity_map(&planes, &left, &all, 0.5, &mut gradient), 0.0);
        assert_eq!(gradient, vec![0.0; 3 * PIXELS]);
    }

    #[test]
    fn opacity_where_nothing_is_seen_costs_nothing() {
        let (plane, mask) = (random(PIXELS, 7, 0.0, 1.0), random(PIXELS, 8, 0.0, 1.0));
        let ignored: Vec<u8> = (0..PIXELS).map(|pixel| u8::from(pixel % 3 == 0)).collect();
        let mut gradient = vec![0.0; PIXELS];
        let value = opacity_map(&plane, &mask, Some(&ignored), 2.0, &mut gradient);
        let reference = |plane: &[f64]| -> f64 {
            let seen = (0..PIXELS).filter(|&pixel| ignored[pixel] == 0);
            let error = |pixel: usize| (plane[pixel] - f64::from(mask[pixel])).abs();
            seen.map(error).sum::<f64>() / PIXELS as f64
        };
        let wide: Vec<f64> = plane.iter().map(|&v| f64::from(v)).collect();
        assert!((value - reference(&wide)).abs() < 1e-6);
        check(&plane, 2.0, &gradient, reference);
    }

    #[test]
    fn short_lifespans_and_false_opacity_are_penalized() {
        let (plane, left) = (random(PIXELS, 4, 0.0, 1.0), random(PIXELS, 5, 0.0, 0.9));
        let mut gradient = vec![0.0; PIXELS];
        let value = lifespan_map(&plane, &left, 2.0, &mut gradient);
        let reference = |plane: &[f64]| -> f64 {
            let at = |(v, t): (&f64, &f32)| v / (1.0 - f64::from(*t) + 1e-5);
            -plane.iter().zip(&left).map(at).sum::<f64>() / PIXELS as f64
        };
        assert!(value < 0.0);
        check(&plane, 2.0, &gradient, reference);

        let mask = random(PIXELS, 6, 0.0, 1.0);
        let mut gradient = vec![0.0; PIXELS];
        opacity_map(&plane, &mask, None, 2.0, &mut gradient);
        check(&plane, 2.0, &gradient, |plane| {
            let at = |(v, m): (&f64, &f32)| (v - f64::from(*m)).abs();
            plane.iter().zip(&mask).map(at).sum::<f64>() / PIXELS as f64
        });
        // An empty dynamic set before an empty mask: nothing to pay, nothing to change.
        let mut gradient = vec![0.0; PIXELS];
        assert_eq!(
            opacity_map(&[0.0; PIXELS], &[0.0; PIXELS], None, 1.0, &mut gradient),
            0.0
        );
        assert_eq!(gradient, [0.0; PIXELS]);
    }

    #[test]
    fn an_empty_image_has_finite_gradients() {
        let mut gradient = vec![0.0; 3 * PIXELS];
        let nothing = vec![1.0; PIXELS];
        let value = velocity_map(&[0.0; 3 * PIXELS], &nothing, &[], 1.0, &mut gradient);
        assert_eq!((value, gradient.iter().all(|g| *g == 0.0)), (0.0, true));
        let mut gradient = vec![0.0; PIXELS];
        lifespan_map(&[0.0; PIXELS], &nothing, 1.0, &mut gradient);
        assert!(gradient.iter().all(|g| g.is_finite()));
    }
}
