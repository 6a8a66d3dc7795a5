//! Adam on the CPU.

use rayon::prelude::*;

use crate::parameters::ParameterArray;
use crate::parameters::adam::{BETA_1, Corrections, EPSILON, SecondMomentDecay, corrections};

/// Takes step number `step` (from 1) on an array with its own learning rate. Gradients that are not finite
/// count as zero; returns their number.
pub fn step(array: &mut ParameterArray, step: u64, decay: SecondMomentDecay) -> usize {
    let corrections = corrections(step, decay);
    let rate = corrections.rate(array.learning_rate);
    const CHUNK: usize = 1 << 13;
    (
        array.values.par_chunks_mut(CHUNK),
        array.first_moments.par_chunks_mut(CHUNK),
        array.second_moments.par_chunks_mut(CHUNK),
        array.gradients.par_chunks(CHUNK),
    )
        .into_par_iter()
        .map(|(values, first, second, gradients)| {
            step_values([values, first, second], gradients, rate, corrections)
        })
        .sum()
}

/// Updates some values with their first and second moments; `rate` includes the corrections. Returns the
/// number of gradients that were not finite.
pub(crate) fn step_values(
    [values, first, second]: [&mut [f32]; 3],
    gradients: &[f32],
    rate: f32,
    corrections: Corrections,
) -> usize {
    let Corrections {
        beta_2,
        inverse_root,
        ..
    } = corrections;
    let mut refused = 0;
    for (((value, m), v), &g) in values.iter_mut().zip(first).zip(second).zip(gradients) {
        let finite = g.is_finite();
        refused += usize::from(!finite);
        let g = if finite { g } else { 0.0 };
        *m = BETA_1 * *m + (1.0 - BETA_1) * g;
        *v = beta_2 * *v + (1.0 - beta_2) * g * g;
        *value -= rate * *m / (v.sqrt() * inverse_root + EPSILON);
    }
    refused
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::ParameterTable;

    /// Returns the update written out in f64 for one value.
    fn reference(gradients: &[f64], rate: f64) -> f64 {
        let (mut x, mut m, mut v) = (1.0, 0.0, 0.0);
        for (index, g) in gradients.iter().enumerate() {
            let t = index as i32 + 1;
            m = 0.9 * m + 0.1 * g;
            v = 0.999 * v + 0.001 * g * g;
            x -= rate * (m / (1.0 - 0.9_f64.powi(t)))
                / ((v / (1.0 - 0.999_f64.powi(t))).sqrt() + 1e-15);
        }
        x
    }

    #[test]
    fn follows_the_reference_and_refuses_nan() {
        let gradients = [0.3, -0.1, 0.7, 1e-9, 0.2];
        let mut table = ParameterTable::new(2);
        table.add("a", 1, vec![1.0, 1.0], 0.01);
        for (index, &g) in gradients.iter().enumerate() {
            table.arrays[0].gradients = vec![g as f32, f32::NAN];
            assert_eq!(
                step(
                    &mut table.arrays[0],
                    index as u64 + 1,
                    SecondMomentDecay::PUBLISHED
                ),
                1
            );
        }
        let expected = reference(&gradients, 0.01);
        assert!((f64::from(table.arrays[0].values[0]) - expected).abs() < 1e-6);
        assert_eq!(table.arrays[0].values[1], 1.0);
    }
}
