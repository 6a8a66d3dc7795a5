//! Distance between the features of two images.

use std::ops::Range;

use rayon::prelude::*;

/// Added to the length of a pixel's features before they are divided by it.
const EPSILON: f32 = 1e-10;
/// Channels that are added up side by side; every stage has a multiple of them.
const LANES: usize = 8;

/// Returns the sum over the pixels of some rows of the weighted squared differences of two images' features of unit
/// length.
pub(super) fn weighted(
    images: [&[f32]; 2],
    row_len: usize,
    rows: Range<usize>,
    weights: &[f32],
) -> f64 {
    let [left, right] = images.map(|values| &values[rows.start * row_len..rows.end * row_len]);
    let rows: Vec<f64> = left
        .par_chunks_exact(row_len)
        .zip(right.par_chunks_exact(row_len))
        .map(|(left, right)| row(left, right, weights))
        .collect();
    rows.iter().sum()
}

#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn row(left: &[f32], right: &[f32], weights: &[f32]) -> f64 {
    let channels = weights.len();
    left.chunks_exact(channels)
        .zip(right.chunks_exact(channels))
        .map(|(left, right)| {
            let (mut lengths, mut other_lengths) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            let blocks = left.as_chunks::<LANES>().0.iter();
            for (left, right) in blocks.zip(right.as_chunks::<LANES>().0) {
                for lane in 0..LANES {
                    lengths[lane] += left[lane] * left[lane];
                    other_lengths[lane] += right[lane] * right[lane];
                }
            }
            let [scale, other_scale] = [lengths, other_lengths]
                .map(|lengths| 1.0 / (lengths.iter().sum::<f32>().sqrt() + EPSILON));
            let mut sums = [0.0_f32; LANES];
            let blocks = left.as_chunks::<LANES>().0.iter();
            let blocks = blocks.zip(right.as_chunks::<LANES>().0);
            for ((left, right), weights) in blocks.zip(weights.as_chunks::<LANES>().0) {
                for lane in 0..LANES {
                    let difference = scale * left[lane] - other_scale * right[lane];
                    sums[lane] += weights[lane] * (difference * difference);
                }
            }
            f64::from(sums.iter().sum::<f32>())
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use omnilife_networks::Features;

    use super::*;

    #[test]
    fn weighted_differences_are_those_of_the_definition() {
        let mut features = Features::zeros(2, 3, 5, 16);
        for (at, value) in features.data.iter_mut().enumerate() {
            *value = ((at * 29 + 7) % 83) as f32 / 40.0;
        }
        // A pixel that no channel responds to has no direction, and does not divide by zero.
        features.data[..16].fill(0.0);
        let weights: Vec<f32> = (0..16).map(|channel| channel as f32 / 10.0).collect();
        let mut expected = 0.0;
        for (left, right) in features
            .image(0)
            .chunks_exact(16)
            .zip(features.image(1).chunks_exact(16))
        {
            let unit = |values: &[f32]| -> Vec<f64> {
                let squares = values.iter().map(|&v| f64::from(v) * f64::from(v));
                let length = squares.sum::<f64>().sqrt() + 1e-10;
                values.iter().map(|&v| f64::from(v) / length).collect()
            };
            for (channel, (l, r)) in unit(left).iter().zip(unit(right)).enumerate() {
                expected += f64::from(weights[channel]) * (l - r) * (l - r);
            }
        }
        let images = [0, 1].map(|image| features.image(image));
        let found = weighted(images, features.row_len(), 0..3, &weights);
        assert!(
            (found - expected).abs() < 1e-5 * expected,
            "{found} {expected}"
        );
    }
}
