//! The layers of a network and the location of their weights.
//!
//! ```text
//! h_0 = relu(W_0 [x, s] + b_0)        h_i = relu(W_i h_(i-1) + b_i)        y = W h_last + b
//! ```
//!
//! Every row has its own inputs `x`. The inputs `s` are shared by all rows of an evaluation, so that their
//! contribution to a layer is one vector, computed once. With a skip connection, one layer's output is
//! concatenated with both again.
//!
//! All weights are one array, layer by layer, the output layer last. A layer has the weights of hidden
//! inputs, of row inputs and of shared inputs (each with a row per input and a column per output), then the
//! biases, if any.

use std::ops::Range;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkShape {
    /// Inputs of each row.
    pub row_inputs: usize,
    /// Inputs shared by all rows of an evaluation.
    pub shared_inputs: usize,
    /// Hidden layers, 1 or more.
    pub depth: usize,
    /// Width of each hidden layer.
    pub width: usize,
    /// Layer, from 0 and before the last, whose output is concatenated with the inputs again.
    pub skip_after: Option<usize>,
    /// True if layers add a bias.
    pub has_biases: bool,
    /// Outputs of the network.
    pub outputs: usize,
}

/// One layer: its number of inputs of each kind, and the offset of its weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layer {
    /// Inputs from the previous layer.
    pub hidden_inputs: usize,
    /// Inputs of the row.
    pub row_inputs: usize,
    /// Shared inputs.
    pub shared_inputs: usize,
    /// Outputs.
    pub outputs: usize,
    has_biases: bool,
    begin: usize,
}

impl Layer {
    /// Returns the range of the weights of hidden inputs.
    pub fn hidden_weights(&self) -> Range<usize> {
        self.begin..self.begin + self.hidden_inputs * self.outputs
    }

    /// Returns the range of the weights of row inputs.
    pub fn row_weights(&self) -> Range<usize> {
        let begin = self.hidden_weights().end;
        begin..begin + self.row_inputs * self.outputs
    }

    /// Returns the range of the weights of shared inputs.
    pub fn shared_weights(&self) -> Range<usize> {
        let begin = self.row_weights().end;
        begin..begin + self.shared_inputs * self.outputs
    }

    /// Returns the range of the biases; empty for a network without them.
    pub fn biases(&self) -> Range<usize> {
        let begin = self.shared_weights().end;
        let count = if self.has_biases { self.outputs } else { 0 };
        begin..begin + count
    }

    /// Returns the number of all inputs.
    pub fn inputs(&self) -> usize {
        self.hidden_inputs + self.row_inputs + self.shared_inputs
    }
}

impl NetworkShape {
    /// Returns all layers, the output layer last.
    pub fn layers(&self) -> Vec<Layer> {
        let mut begin = 0;
        (0..=self.depth)
            .map(|index| {
                let is_output = index == self.depth;
                let takes_inputs = !is_output
                    && (index == 0 || self.skip_after.is_some_and(|after| index == after + 1));
                let layer = Layer {
                    hidden_inputs: if index == 0 { 0 } else { self.width },
                    row_inputs: if takes_inputs { self.row_inputs } else { 0 },
                    shared_inputs: if takes_inputs { self.shared_inputs } else { 0 },
                    outputs: if is_output { self.outputs } else { self.width },
                    has_biases: self.has_biases,
                    begin,
                };
                begin = layer.biases().end;
                layer
            })
            .collect()
    }

    /// Returns the number of weights and biases.
    pub fn weight_count(&self) -> usize {
        self.layers().last().map_or(0, |layer| layer.biases().end)
    }

    /// Returns initial weights: uniform in `+-1/sqrt(inputs)`, as in `PyTorch`'s linear layers; 0 in the
    /// output layer, so that the network's output is 0 until it is trained.
    pub fn initial_weights(&self, seed: u64) -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut weights = vec![0.0; self.weight_count()];
        for layer in self.layers().iter().take(self.depth) {
            let bound = 1.0 / (layer.inputs() as f32).sqrt();
            let of_layer = &mut weights[layer.hidden_weights().start..layer.biases().end];
            of_layer.fill_with(|| random.random_range(-bound..=bound));
        }
        weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts the weights of the network of Deformable-3D-Gaussians by hand.
    #[test]
    fn weights_lie_one_after_the_other() {
        let shape = NetworkShape {
            row_inputs: 63,
            shared_inputs: 21,
            depth: 8,
            width: 256,
            skip_after: Some(4),
            has_biases: true,
            outputs: 10,
        };
        let layers = shape.layers();
        let inputs: Vec<usize> = layers.iter().map(Layer::inputs).collect();
        assert_eq!(inputs, [84, 256, 256, 256, 256, 340, 256, 256, 256]);
        let expected: usize = 84 * 256 + 6 * 256 * 256 + 340 * 256 + 8 * 256 + 256 * 10 + 10;
        assert_eq!(shape.weight_count(), expected);
        for pair in layers.windows(2) {
            assert_eq!(pair[0].biases().end, pair[1].hidden_weights().start);
        }
        let weights = shape.initial_weights(1);
        assert!(
            weights[layers[8].hidden_weights().start..]
                .iter()
                .all(|&w| w == 0.0)
        );
        let first = &weights[..84 * 256];
        let largest = first
            .iter()
            .fold(0.0_f32, |largest, w| largest.max(w.abs()));
        assert!(
            largest <= 1.0 / 84.0_f32.sqrt() && largest > 0.108,
            "{largest}"
        );
    }
}
