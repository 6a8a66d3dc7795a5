//! Networks with random weights and inputs for the tests of both backends.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::fields::mlp::{
    network::NetworkShape,
    passes::{Activations, NetworkGradients},
};

/// Small network with every kind of layer.
pub(super) const SMALL: NetworkShape = NetworkShape {
    row_inputs: 5,
    shared_inputs: 3,
    depth: 4,
    width: 8,
    skip_after: Some(1),
    has_biases: true,
    outputs: 4,
};

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..len).map(|_| random.random_range(-1.0..1.0)).collect()
}

/// A network with its inputs and its upstream gradients.
pub(super) struct Case {
    pub(super) shape: NetworkShape,
    pub(super) rows: usize,
    pub(super) weights: Vec<f32>,
    pub(super) shared: Vec<f32>,
    pub(super) inputs: Vec<f32>,
    pub(super) upstream: Vec<f32>,
}

impl Case {
    pub(super) fn new(shape: NetworkShape, rows: usize) -> Self {
        let mut weights = shape.initial_weights(3);
        let heads = shape.layers()[shape.depth].hidden_weights().start;
        let count = weights.len() - heads;
        weights[heads..].copy_from_slice(&random(count, 4));
        Self {
            shape,
            rows,
            weights,
            shared: random(shape.shared_inputs, 5),
            inputs: random(rows * shape.row_inputs, 6),
            upstream: random(rows * shape.outputs, 7),
        }
    }

    pub(super) fn input(&self, row: usize) -> &[f32] {
        let width = self.shape.row_inputs;
        &self.inputs[row * width..(row + 1) * width]
    }

    /// Returns outputs and gradients by the weights; activations are limited to `limit_bytes`.
    pub(super) fn on_cpu(&self, limit_bytes: usize) -> (Vec<f32>, Vec<f32>) {
        let (out, gradients, _) = self.with_input_gradients(limit_bytes);
        (out, gradients)
    }

    /// Returns outputs and gradients by the weights and by the inputs; activations are limited to
    /// `limit_bytes`.
    pub(super) fn with_input_gradients(
        &self,
        limit_bytes: usize,
    ) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
        let encode = |row: usize, out: &mut [f32]| out.copy_from_slice(self.input(row));
        let mut activations = Activations::new(limit_bytes);
        let mut out = vec![0.0; self.rows * self.shape.outputs];
        let (weights, shared) = (&self.weights, &self.shared);
        self.shape
            .forward(weights, shared, &encode, &mut activations, &mut out);
        let mut gradients = vec![f32::NAN; weights.len()];
        let mut by_inputs = vec![f32::NAN; self.inputs.len()];
        self.shape.backward(
            weights,
            shared,
            &encode,
            &activations,
            &self.upstream,
            NetworkGradients {
                weights: &mut gradients,
                inputs: Some(&mut by_inputs),
            },
        );
        (out, gradients, by_inputs)
    }
}
