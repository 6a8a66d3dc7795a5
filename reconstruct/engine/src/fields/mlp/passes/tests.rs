//! Outputs and gradients against the network written out in f64.

use crate::fields::mlp::cases::{Case, SMALL as SHAPE};
use crate::fields::mlp::passes::*;

const UNLIMITED: usize = usize::MAX;

/// The outputs of one row.
fn reference(weights: &[f64], shared: &[f32], row: &[f32]) -> Vec<f64> {
    let mut hidden: Vec<f64> = Vec::new();
    for (index, layer) in SHAPE.layers().iter().enumerate() {
        let mut out = weights[layer.biases()].to_vec();
        let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let parts = [
            (hidden.clone(), layer.hidden_weights()),
            (wide(row), layer.row_weights()),
            (wide(shared), layer.shared_weights()),
        ];
        for (inputs, range) in parts {
            let rows = weights[range].chunks_exact(layer.outputs);
            for (input, row) in inputs.iter().zip(rows) {
                for (sum, weight) in out.iter_mut().zip(row) {
                    *sum += input * weight;
                }
            }
        }
        if index < SHAPE.depth {
            out.iter_mut().for_each(|value| *value = value.max(0.0));
        }
        hidden = out;
    }
    hidden
}

#[test]
fn outputs_and_gradients_are_those_of_the_definition() {
    let case = Case::new(SHAPE, 11);
    let (out, gradients) = case.on_processor(UNLIMITED);
    let wide: Vec<f64> = case.weights.iter().map(|&w| f64::from(w)).collect();
    let loss = |weights: &[f64]| -> f64 {
        let row = |row: usize| {
            let out = reference(weights, &case.shared, case.input(row));
            let upstream = &case.upstream[row * SHAPE.outputs..];
            out.iter()
                .zip(upstream)
                .map(|(a, &b)| a * f64::from(b))
                .sum::<f64>()
        };
        (0..case.rows).map(row).sum()
    };
    for (row, out) in out.chunks_exact(SHAPE.outputs).enumerate() {
        let expected = reference(&wide, &case.shared, case.input(row));
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

#[test]
fn memory_and_rows_without_a_gradient_change_nothing() {
    let mut case = Case::new(SHAPE, 3 * BLOCK + 17);
    // Some rows of one block, all of another.
    for row in (5..40).chain(BLOCK..2 * BLOCK) {
        case.upstream[row * SHAPE.outputs..(row + 1) * SHAPE.outputs].fill(0.0);
    }
    let (out, gradients) = case.on_processor(UNLIMITED);
    let one_block = SHAPE.activation_bytes(BLOCK, UNLIMITED);
    for limit in [0, one_block, 2 * one_block + 1] {
        let (other_out, other) = case.on_processor(limit);
        assert!(out == other_out && gradients == other, "{limit}");
    }
    // Without leaving rows out: a row of zeros that is just above 0 is not left out.
    for value in &mut case.upstream {
        if *value == 0.0 {
            *value = f32::MIN_POSITIVE;
        }
    }
    let (_, all) = case.on_processor(UNLIMITED);
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
        pool.install(|| case.on_processor(UNLIMITED))
    };
    assert!(with(1) == with(3));
}

#[test]
fn nothing_goes_through() {
    let case = Case::new(SHAPE, 0);
    let (out, gradients) = case.on_processor(UNLIMITED);
    assert!(out.is_empty() && gradients.iter().all(|&g| g == 0.0));
}
