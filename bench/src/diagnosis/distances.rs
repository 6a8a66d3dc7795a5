//! Detection of predicted distances in another unit, and of inverse ones.
//!
//! Scores take distances in the unit of the scene's poses, without any alignment. Networks write them in metres or
//! millimetres, up to a scale, or as disparities.

use std::fmt;

use omnilife_schemas::statistics::median;

use super::look::ViewFacts;
use crate::metrics::{DepthPair, ViewPair};

/// Pixels of a view with both distances, at least and at most; more are thinned evenly.
const LEAST_PIXELS: usize = 100;
const MOST_PIXELS: usize = 1 << 16;
/// Largest spread of a ratio within a view, and largest difference of two views: of its logarithm, the median absolute
/// deviation.
const LARGEST_SPREAD: f64 = 0.2;
const LARGEST_DIFFERENCE: f64 = 0.1;
/// Least factor, or its inverse, that shows another unit.
const LEAST_FACTOR: f64 = 1.5;

/// Meaning of predicted distances in which they fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DistanceMistake {
    /// All are the true ones times one factor.
    Scaled {
        /// The factor.
        factor: f64,
    },
    /// They are large where the true ones are small: disparities.
    Inverse,
}

impl fmt::Display for DistanceMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scaled { factor } => write!(
                f,
                "predicted distances are {factor:.3} times the true ones in all views; write them in the unit of the \
                 scene's poses"
            ),
            Self::Inverse => f.write_str(
                "predicted distances are inverse ones; write distances along the rays, in the unit of the scene's \
                 poses",
            ),
        }
    }
}

/// Predicted distances of a view beside the true ones, by medians and spreads of logarithms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Distances {
    /// Those of the ratio of both.
    ratio: [f64; 2],
    /// Those of their product, which inverse distances leave constant.
    product: [f64; 2],
}

impl Distances {
    /// Compares the distances of a view; `None` where too few pixels have both.
    pub(super) fn of(pair: &ViewPair, depth: &DepthPair) -> Option<Self> {
        let stride = depth.truth.len().div_ceil(MOST_PIXELS).max(1);
        let both = depth.prediction.iter().zip(&depth.truth).enumerate();
        let logarithms: Vec<[f64; 2]> = both
            .step_by(stride)
            .filter(|&(pixel, (&predicted, &truth))| {
                truth > 0.0 && predicted > 0.0 && predicted.is_finite() && pair.counts(pixel)
            })
            .map(|(_, (&predicted, &truth))| {
                let (predicted, truth) = (f64::from(predicted).ln(), f64::from(truth).ln());
                [predicted - truth, predicted + truth]
            })
            .collect();
        if logarithms.len() < LEAST_PIXELS {
            return None;
        }
        let middle_and_spread = |of: usize| -> Option<[f64; 2]> {
            let values: Vec<f64> = logarithms.iter().map(|both| both[of]).collect();
            let middle = median(&values)?;
            let off: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
            Some([middle, median(&off)?])
        };
        Some(Self {
            ratio: middle_and_spread(0)?,
            product: middle_and_spread(1)?,
        })
    }
}

/// Returns the share of the pixels with a true distance that have no predicted one, which metrics take for 0; `None`
/// where no pixel has a true one.
pub(super) fn missing_share(pair: &ViewPair, depth: &DepthPair) -> Option<f64> {
    let (mut missing, mut all) = (0_usize, 0_usize);
    let both = depth.prediction.iter().zip(&depth.truth).enumerate();
    for (_, (&predicted, _)) in
        both.filter(|&(pixel, (_, &truth))| truth > 0.0 && pair.counts(pixel))
    {
        missing += usize::from(!(predicted > 0.0 && predicted.is_finite()));
        all += 1;
    }
    (all > 0).then(|| missing as f64 / all as f64)
}

/// Returns the mistake of all views; `None` where one of them has no distances.
pub(super) fn mistake(views: &[ViewFacts]) -> Option<DistanceMistake> {
    let known: Option<Vec<Distances>> = views.iter().map(|view| view.distances).collect();
    mistake_of(&known?)
}

fn mistake_of(views: &[Distances]) -> Option<DistanceMistake> {
    if views.is_empty() {
        return None;
    }
    let is_inverse = |view: &Distances| {
        view.product[1] <= LARGEST_SPREAD && view.ratio[1] > 2.0 * LARGEST_SPREAD
    };
    if views.iter().all(is_inverse) {
        return Some(DistanceMistake::Inverse);
    }
    let factors: Vec<f64> = views.iter().map(|view| view.ratio[0]).collect();
    let factor = median(&factors)?;
    let is_of_factor = |view: &Distances| {
        let [middle, spread] = view.ratio;
        spread <= LARGEST_SPREAD && (middle - factor).abs() <= LARGEST_DIFFERENCE
    };
    let tells = factor.abs() >= LEAST_FACTOR.ln() && views.iter().all(is_of_factor);
    tells.then(|| DistanceMistake::Scaled {
        factor: factor.exp(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [32, 16];

    /// Returns the mistake of views whose distances `change` makes of the true ones, of the number of the view and of
    /// the pixel.
    fn found(change: impl Fn(usize, usize, f32) -> f32) -> Option<DistanceMistake> {
        let count = SIZE[0] * SIZE[1];
        let truth: Vec<f32> = (0..count)
            .map(|pixel| 1.0 + 0.02 * (pixel * 37 % count) as f32)
            .collect();
        let of_view = |view: usize| {
            let pixels = truth.iter().enumerate();
            let prediction = pixels.map(|(pixel, &true_one)| change(view, pixel, true_one));
            let depth = DepthPair {
                prediction: prediction.collect(),
                truth: truth.clone(),
            };
            let image = vec![7; 3 * count];
            let pair = ViewPair::new(SIZE[0], SIZE[1], image.clone(), image)?;
            Distances::of(&pair, &depth)
        };
        let views: Vec<Distances> = (0..4).filter_map(of_view).collect();
        mistake_of(&views)
    }

    #[test]
    fn units_and_inverse_distances_are_found() {
        let noisy = |pixel: usize| 0.9 + 0.2 * (pixel % 7) as f32 / 6.0;
        for unit in [1000.0_f32, 0.01, 2.5] {
            let scaled = found(|_, pixel, distance| unit * noisy(pixel) * distance);
            let factor = match scaled {
                Some(DistanceMistake::Scaled { factor }) => factor,
                other => panic!("{unit}: {other:?}"),
            };
            assert!((factor / f64::from(unit) - 1.0).abs() < 0.1, "{factor}");
        }
        // Of another scale in every view, as a network normalizes them.
        let inverse = found(|view, pixel, distance| (1 + view) as f32 * noisy(pixel) / distance);
        assert_eq!(inverse, Some(DistanceMistake::Inverse));
    }

    /// NaN, 0, negative and infinite ones, where there is a true one and the pixel counts.
    #[test]
    fn missing_distances_are_counted() -> Result<(), &'static str> {
        let image = vec![7; 3 * 8];
        let pair = ViewPair::new(4, 2, image.clone(), image).ok_or("a pair")?;
        let depth = |prediction: [f32; 8], truth: [f32; 8]| DepthPair {
            prediction: prediction.to_vec(),
            truth: truth.to_vec(),
        };
        let found = [f32::NAN, 0.0, -1.0, f32::INFINITY, 2.0, 2.0, 2.0, 2.0];
        assert_eq!(missing_share(&pair, &depth(found, [2.0; 8])), Some(0.5));
        let truth = [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0, 0.0];
        assert_eq!(missing_share(&pair, &depth(found, truth)), Some(0.25));
        assert_eq!(missing_share(&pair, &depth(found, [0.0; 8])), None);
        Ok(())
    }

    #[test]
    fn distances_of_the_unit_have_no_mistake() {
        assert_eq!(found(|_, _, distance| distance), None);
        assert_eq!(found(|_, _, distance| 1.3 * distance), None);
        // Views of several scales, noise without structure, one distance everywhere, and none.
        let scales = [0.5_f32, 1.0, 2.0, 4.0];
        assert_eq!(found(|view, _, distance| scales[view] * distance), None);
        let scattered = |_, pixel: usize, distance: f32| distance * [0.2_f32, 1.0, 5.0][pixel % 3];
        assert_eq!(found(scattered), None);
        assert_eq!(found(|_, _, _| 5.0), None);
        assert_eq!(found(|_, _, _| 0.0), None);
    }
}
