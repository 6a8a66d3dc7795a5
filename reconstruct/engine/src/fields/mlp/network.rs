//! The layers of a network and where their weights are.
//!
//! ```text
//! h_0 = relu(W_0 [x, s] + b_0)        h_i = relu(W_i h_(i-1) + b_i)        y = W h_last + b
//! ```
//!
//! Every row has inputs `x` of its own; the inputs `s` are shared by all rows of an evaluation, so
//! that what they add to a layer is one vector, computed once. After one of the layers both are put
//! beside its output again (a skip connection), where the network has one.
//!
//! All weights are one array, layer by layer: those of hidden inputs, of row inputs, of shared inputs
//! (each with a row per input and a column per output), then the biases, where the network has any. The
//! output layer is the last.

use std::ops::Range;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkShape {
    /// Inputs that every row has of its own.
    pub row_inputs: usize,
    /// Inputs that are the same for all rows of an evaluation.
    pub shared_inputs: usize,
    /// Layers with an activation, 1 or more.
    pub depth: usize,
    /// Outputs of each of them.
    pub width: usize,
    /// The layer, from 0, after which the inputs are put beside its output; one before the last.
    pub skip_after: Option<usize>,
    /// Whether a constant is added to what a layer puts out.
    pub has_biases: bool,
    /// Outputs of the network.
    pub outputs: usize,
}

/// One layer: how many inputs of each kind it has, and where its weights begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layer {
    /// Outputs of the layer before that come in.
    pub hidden_inputs: usize,
    /// Inputs of a row that come in.
    pub row_inputs: usize,
    /// Shared inputs that come in.
    pub shared_inputs: usize,
    /// Outputs.
    pub outputs: usize,
    has_biases: bool,
    begin: usize,
}

impl Layer {
    /// Where the weights of hidden inputs are.
    pub fn hidden_weights(&self) -> Range<usize> {
        self.begin..self.begin + self.hidden_inputs * self.outputs
    }

    /// Where the weights of row inputs are.
    pub fn row_weights(&self) -> Range<usize> {
        let begin = self.hidden_weights().end;
        begin..begin + self.row_inputs * self.outputs
    }

    /// Where the weights of shared inputs are.
    pub fn shared_weights(&self) -> Range<usize> {
        let begin = self.row_weights().end;
        begin..begin + self.shared_inputs * self.outputs
    }

    /// Where the biases are; empty where there are none.
    pub fn biases(&self) -> Range<usize> {
        let begin = self.shared_weights().end;
        let count = if self.has_biases { self.outputs } else { 0 };
        begin..begin + count
    }

    /// All inputs.
    pub fn inputs(&self) -> usize {
        self.hidden_inputs + self.row_inputs + self.shared_inputs
    }
}

impl NetworkShape {
    /// All layers, the output layer last.
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

    /// Number of weights and biases.
    pub fn weight_count(&self) -> usize {
        self.layers().last().map_or(0, |layer| layer.biases().end)
    }

    /// First weights: evenly from `+-1/sqrt(inputs)`, as `PyTorch` draws those of linear layers; 0 in the
    /// output layer, so that the network says 0 until it is trained.
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

    /// The network of Deformable-3D-Gaussians, counted by hand.
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
