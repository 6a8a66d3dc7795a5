//! Outputs and gradients compared with the network written out in f64.

use crate::fields::mlp::cases::{Case, SMALL as SHAPE};
use crate::fields::mlp::{passes::*, reference};
use crate::golden_tests::{golden, numbers, wave};

const UNLIMITED: usize = usize::MAX;

fn widened(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

#[test]
fn outputs_and_gradients_are_those_of_the_definition() {
    let case = Case::new(SHAPE, 11);
    let (out, gradients) = case.on_cpu(UNLIMITED);
    let wide = widened(&case.weights);
    let shared = widened(&case.shared);
    let input = |row: usize| widened(case.input(row));
    let loss = |weights: &[f64]| -> f64 {
        let row = |row: usize| {
            let out = reference::outputs(SHAPE, weights, &shared, &input(row));
            let upstream = &case.upstream[row * SHAPE.outputs..];
            out.iter()
                .zip(upstream)
                .map(|(a, &b)| a * f64::from(b))
                .sum::<f64>()
        };
        (0..case.rows).map(row).sum()
    };
    for (row, out) in out.chunks_exact(SHAPE.outputs).enumerate() {
        let expected = reference::outputs(SHAPE, &wide, &shared, &input(row));
        for (found, expected) in out.iter().zip(expected) {
            assert!(
                (f64::from(*found) - expected).abs() < 1e-5,
                "{found} {expected}"
            );
        }
    }
    for (index, found) in gradients.iter().enumerate() {
        let shifted = |step: f64| {
            let mut shifted = wide.clone();
            shifted[index] += step;
            loss(&shifted)
        };
        let expected = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
        let error = (f64::from(*found) - expected).abs();
        assert!(
            error < 1e-4 * (1.0 + expected.abs()),
            "{index}: {found} {expected}"
        );
    }
}

/// A network without biases and skip connection, as behind a hash grid.
const PLAIN: NetworkShape = NetworkShape {
    row_inputs: 16,
    shared_inputs: 0,
    depth: 2,
    width: 8,
    skip_after: None,
    has_biases: false,
    outputs: 3,
};

#[test]
fn gradients_by_inputs_are_central_differences() {
    for shape in [SHAPE, PLAIN] {
        let mut case = Case::new(shape, 2 * BLOCK + 5);
        // Rows without a gradient are skipped, and get none.
        case.upstream[3 * shape.outputs..9 * shape.outputs].fill(0.0);
        let (_, by_weights, by_inputs) = case.with_input_gradients(UNLIMITED);
        let wide = widened(&case.weights);
        let shared = widened(&case.shared);
        for row in [0, 3, 10, BLOCK - 1, 2 * BLOCK + 4] {
            let upstream = &case.upstream[row * shape.outputs..(row + 1) * shape.outputs];
            for axis in 0..shape.row_inputs {
                let moved = |step: f64| -> f64 {
                    let mut inputs = widened(case.input(row));
                    inputs[axis] += step;
                    let out = reference::outputs(shape, &wide, &shared, &inputs);
                    out.iter()
                        .zip(upstream)
                        .map(|(a, &b)| a * f64::from(b))
                        .sum()
                };
                let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let found = by_inputs[row * shape.row_inputs + axis];
                assert!(
                    (f64::from(found) - expected).abs() < 1e-4,
                    "{found} {expected}"
                );
            }
        }
        // Recomputed activations give the same bits.
        let (_, again_by_weights, again) = case.with_input_gradients(0);
        assert!(again == by_inputs && again_by_weights == by_weights);
    }
}

#[test]
fn a_network_without_biases_is_golden() {
    let shape = NetworkShape { depth: 2, ..PLAIN };
    let sizes = [16, 8, 8, 3];
    let count: usize = sizes.windows(2).map(|pair| pair[0] * pair[1]).sum();
    assert_eq!(shape.weight_count(), count);
    let inputs = wave(16, 0.3, 1.0);
    let mut out = vec![0.0; 3];
    shape.forward(
        &wave(count, 0.9, 0.7),
        &[],
        &|_, row: &mut [f32]| row.copy_from_slice(&inputs),
        &mut Activations::new(0),
        &mut out,
    );
    for (found, expected) in out.iter().zip(numbers(&golden()["network"])) {
        assert!(
            (f64::from(*found) - expected).abs() < 1e-6,
            "{found} {expected}"
        );
    }
}

#[test]
fn memory_and_rows_without_a_gradient_change_nothing() {
    let mut case = Case::new(SHAPE, 3 * BLOCK + 17);
    // Some rows of one block, all of another.
    for row in (5..40).chain(BLOCK..2 * BLOCK) {
        case.upstream[row * SHAPE.outputs..(row + 1) * SHAPE.outputs].fill(0.0);
    }
    let (out, gradients) = case.on_cpu(UNLIMITED);
    let one_block = SHAPE.activation_bytes(BLOCK, UNLIMITED);
    for limit in [0, one_block, 2 * one_block + 1] {
        let (other_out, other) = case.on_cpu(limit);
        assert!(out == other_out && gradients == other, "{limit}");
    }
    // The reference skips no row: a gradient slightly above 0 is not skipped.
    for value in &mut case.upstream {
        if *value == 0.0 {
            *value = f32::MIN_POSITIVE;
        }
    }
    let (_, all) = case.on_cpu(UNLIMITED);
    let largest = all.iter().fold(0.0_f32, |largest, g| largest.max(g.abs()));
    for (a, b) in gradients.iter().zip(&all) {
        assert!((a - b).abs() < 1e-5 * largest, "{a} {b}");
    }
}

#[test]
fn gradients_do_not_depend_on_the_number_of_threads() {
    let case = Case::new(SHAPE, 9 * BLOCK + 1);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().expect("threads");
        pool.install(|| case.on_cpu(UNLIMITED))
    };
    assert!(with(1) == with(3));
}

#[test]
fn nothing_goes_through() {
    let case = Case::new(SHAPE, 0);
    let (out, gradients) = case.on_cpu(UNLIMITED);
    assert!(out.is_empty() && gradients.iter().all(|&g| g == 0.0));
}
