//! Forward and backward passes of a network over many rows.
//!
//! Rows go through all layers in blocks, so that a block's activations stay in the cache between one layer
//! and the next. The backward pass needs them again: blocks keep them up to a memory limit, and the others
//! are evaluated once more. Gradients of the weights are summed in a fixed number of parts, so that they do
//! not depend on the number of threads.

mod rows;

use rayon::prelude::*;

use self::rows::{add, add_offset, add_offset_and_clip, clip, clip_and_sum_columns, sum_columns};
use crate::fields::mlp::{
    network::{Layer, NetworkShape},
    product::{Factor, multiply, multiply_add},
};

/// Rows of a block. Its activations are a quarter of a mebibyte per layer of 256, and a layer's weights are
/// reused for as many rows.
const BLOCK: usize = 256;
/// Number of partial sums of gradients.
const PARTS: usize = 16;

/// Activations of the forward pass, kept for the backward pass.
#[derive(Debug)]
pub struct Activations {
    limit_bytes: usize,
    /// Per block: the inputs of its rows, then the outputs of each layer.
    kept: Vec<f32>,
}

impl Activations {
    /// Creates storage for at most `limit_bytes` of activations.
    pub fn new(limit_bytes: usize) -> Self {
        Self {
            limit_bytes,
            kept: Vec::new(),
        }
    }

    /// Sets the limit of the next forward pass.
    pub fn set_limit_bytes(&mut self, limit_bytes: usize) {
        self.limit_bytes = limit_bytes;
    }
}

/// Destination of the gradients of a backward pass, which overwrite it.
#[derive(Debug)]
pub struct NetworkGradients<'a> {
    /// Gradient by each weight.
    pub weights: &'a mut [f32],
    /// Gradient by the inputs of each row, if wanted.
    pub inputs: Option<&'a mut [f32]>,
}

impl<'a> NetworkGradients<'a> {
    /// Creates a destination without gradients by the inputs.
    pub fn by_weights(weights: &'a mut [f32]) -> Self {
        Self {
            weights,
            inputs: None,
        }
    }
}

/// A network with its weights, evaluated at given shared inputs.
struct Evaluation<'a> {
    shape: NetworkShape,
    layers: Vec<Layer>,
    weights: &'a [f32],
    /// Contribution of biases and shared inputs to each layer.
    offsets: Vec<Vec<f32>>,
}

impl NetworkShape {
    /// Returns the number of values that a block keeps.
    fn block_len(&self) -> usize {
        BLOCK * (self.row_inputs + self.depth * self.width)
    }

    /// Returns the bytes of the activations of `rows` rows, at most `limit`.
    pub fn activation_bytes(&self, rows: usize, limit: usize) -> usize {
        let blocks = rows.div_ceil(BLOCK);
        blocks
            .saturating_mul(self.block_len() * size_of::<f32>())
            .min(limit)
    }

    /// Computes the outputs of `out.len() / outputs` rows. `encode` writes the inputs of one.
    pub fn forward(
        &self,
        weights: &[f32],
        shared: &[f32],
        encode: &(impl Fn(usize, &mut [f32]) + Sync),
        activations: &mut Activations,
        out: &mut [f32],
    ) {
        let network = Evaluation::new(*self, weights, shared);
        let per_block = BLOCK * self.outputs;
        let blocks = out.len().div_ceil(per_block);
        let block_bytes = self.block_len() * size_of::<f32>();
        let kept = blocks.min(activations.limit_bytes / block_bytes);
        activations.kept.resize(kept * self.block_len(), 0.0);
        let (first, rest) = out.split_at_mut((kept * per_block).min(out.len()));
        first
            .par_chunks_mut(per_block)
            .zip(activations.kept.par_chunks_mut(self.block_len()))
            .enumerate()
            .for_each(|(block, (out, activations))| {
                network.forward_block(block * BLOCK, encode, activations, out);
            });
        rest.par_chunks_mut(per_block).enumerate().for_each_init(
            || vec![0.0; self.block_len()],
            |activations, (block, out)| {
                network.forward_block((kept + block) * BLOCK, encode, activations, out);
            },
        );
    }

    /// Computes gradients from those by the outputs, after [`NetworkShape::forward`] with the same arguments.
    pub fn backward(
        &self,
        weights: &[f32],
        shared: &[f32],
        encode: &(impl Fn(usize, &mut [f32]) + Sync),
        activations: &Activations,
        upstream: &[f32],
        by: NetworkGradients<'_>,
    ) {
        let network = Evaluation::new(*self, weights, shared);
        let gradients = by.weights;
        let blocks: Vec<&[f32]> = upstream.chunks(BLOCK * self.outputs).collect();
        let kept: Vec<&[f32]> = activations.kept.chunks(self.block_len()).collect();
        let per_part = blocks.len().div_ceil(PARTS).max(1);
        let mut by_inputs = match by.inputs {
            Some(inputs) => {
                inputs.fill(0.0);
                let blocks = inputs.chunks_mut(BLOCK * self.row_inputs);
                blocks.map(Some).collect::<Vec<_>>()
            }
            None => blocks.iter().map(|_| None).collect(),
        };
        let parts: Vec<Vec<f32>> = blocks
            .par_chunks(per_part)
            .zip(by_inputs.par_chunks_mut(per_part))
            .enumerate()
            .map(|(part, (blocks, by_inputs))| {
                let mut sums = vec![0.0; gradients.len()];
                let mut scratch = Scratch::new(self);
                for (index, (upstream, by_inputs)) in blocks.iter().zip(by_inputs).enumerate() {
                    let block = part * per_part + index;
                    let kept = kept.get(block).copied();
                    let by = NetworkGradients {
                        weights: &mut sums,
                        inputs: by_inputs.as_deref_mut(),
                    };
                    let first_row = block * BLOCK;
                    network.backward_block(first_row, encode, kept, upstream, &mut scratch, by);
                }
                sums
            })
            .collect();
        const CHUNK: usize = 1 << 14;
        gradients
            .par_chunks_mut(CHUNK)
            .enumerate()
            .for_each(|(chunk, gradients)| {
                gradients.fill(0.0);
                for part in &parts {
                    add(gradients, &part[chunk * CHUNK..]);
                }
            });
        network.gradients_by_shared_weights(shared, gradients);
    }
}

/// Buffers of one part of a backward pass.
struct Scratch {
    /// Recomputed activations, or those of the rows that have a gradient.
    activations: Vec<f32>,
    gathered: Vec<f32>,
    upstream: Vec<f32>,
    by_output: Vec<f32>,
    by_input: Vec<f32>,
    outputs: Vec<f32>,
}

impl Scratch {
    fn new(shape: &NetworkShape) -> Self {
        let layer = || vec![0.0; BLOCK * shape.width];
        Self {
            activations: Vec::new(),
            gathered: Vec::new(),
            upstream: Vec::new(),
            by_output: layer(),
            by_input: layer(),
            outputs: vec![0.0; BLOCK * shape.outputs],
        }
    }
}

impl<'a> Evaluation<'a> {
    fn new(shape: NetworkShape, weights: &'a [f32], shared: &[f32]) -> Self {
        assert_eq!(
            weights.len(),
            shape.weight_count(),
            "weights of the network"
        );
        let layers = shape.layers();
        let offsets = layers
            .iter()
            .map(|layer| {
                let mut offset = weights[layer.biases()].to_vec();
                offset.resize(layer.outputs, 0.0);
                let rows = weights[layer.shared_weights()].chunks_exact(layer.outputs);
                for (row, input) in rows.zip(shared) {
                    for (sum, weight) in offset.iter_mut().zip(row) {
                        *sum += input * weight;
                    }
                }
                offset
            })
            .collect();
        Self {
            shape,
            layers,
            weights,
            offsets,
        }
    }

    /// Returns the inputs of a block's rows, and the outputs of each layer.
    fn split<'b>(&self, block: &'b [f32], rows: usize) -> (&'b [f32], Vec<&'b [f32]>) {
        let (inputs, hidden) = block.split_at(BLOCK * self.shape.row_inputs);
        let layers = hidden.chunks_exact(BLOCK * self.shape.width);
        (
            &inputs[..rows * self.shape.row_inputs],
            layers
                .map(|layer| &layer[..rows * self.shape.width])
                .collect(),
        )
    }

    fn forward_block(
        &self,
        first_row: usize,
        encode: &impl Fn(usize, &mut [f32]),
        activations: &mut [f32],
        out: &mut [f32],
    ) {
        let NetworkShape {
            row_inputs,
            depth,
            width,
            outputs,
            ..
        } = self.shape;
        let rows = out.len() / outputs;
        let (inputs, hidden) = activations.split_at_mut(BLOCK * row_inputs);
        let inputs = &mut inputs[..rows * row_inputs];
        for (row, inputs) in inputs.chunks_exact_mut(row_inputs).enumerate() {
            encode(first_row + row, inputs);
        }
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, rest) = hidden.split_at_mut(index * BLOCK * width);
            let previous = before.rchunks_exact(BLOCK * width).next();
            let previous = previous.map(|layer| &layer[..rows * width]);
            let is_output = index == depth;
            let to = if is_output {
                &mut *out
            } else {
                &mut rest[..rows * width]
            };
            self.weigh(layer, previous, inputs, to);
            if is_output {
                add_offset(to, &self.offsets[index]);
            } else {
                add_offset_and_clip(to, &self.offsets[index]);
            }
        }
    }

    /// Computes the weighted inputs of a layer, without biases and shared inputs.
    fn weigh(&self, layer: &Layer, previous: Option<&[f32]>, inputs: &[f32], out: &mut [f32]) {
        let row_weights = || Factor::new(&self.weights[layer.row_weights()], layer.outputs);
        let inputs = || Factor::new(inputs, layer.row_inputs);
        match previous {
            Some(previous) => {
                let weights = Factor::new(&self.weights[layer.hidden_weights()], layer.outputs);
                multiply(Factor::new(previous, layer.hidden_inputs), weights, out);
                if layer.row_inputs > 0 {
                    multiply_add(inputs(), row_weights(), out);
                }
            }
            None => multiply(inputs(), row_weights(), out),
        }
    }

    /// Adds a block's gradients by the weights, and writes those by its inputs. Gradients by weights of
    /// shared inputs are added later. Rows without a gradient (Gaussians outside the view) are skipped.
    fn backward_block(
        &self,
        first_row: usize,
        encode: &impl Fn(usize, &mut [f32]),
        kept: Option<&[f32]>,
        upstream: &[f32],
        scratch: &mut Scratch,
        by: NetworkGradients<'_>,
    ) {
        let shape = &self.shape;
        let rows = upstream.len() / shape.outputs;
        let all = upstream.chunks_exact(shape.outputs);
        let seen: Vec<usize> = all
            .enumerate()
            .filter(|(_, row)| row.iter().any(|&value| value != 0.0))
            .map(|(row, _)| row)
            .collect();
        if seen.is_empty() {
            return;
        }
        let Scratch {
            activations,
            gathered,
            upstream: seen_upstream,
            by_output,
            by_input,
            outputs,
        } = scratch;
        let block = kept.unwrap_or_else(|| {
            activations.resize(shape.block_len(), 0.0);
            self.forward_block(
                first_row,
                encode,
                activations,
                &mut outputs[..upstream.len()],
            );
            activations
        });
        if seen.len() == rows {
            self.backward_rows(block, upstream, [by_output, by_input], by);
            return;
        }
        seen_upstream.clear();
        for &row in &seen {
            let from = &upstream[row * shape.outputs..(row + 1) * shape.outputs];
            seen_upstream.extend_from_slice(from);
        }
        self.gather(block, &seen, gathered);
        let width = shape.row_inputs;
        let mut of_seen = by.inputs.as_ref().map(|_| vec![0.0; seen.len() * width]);
        let by_seen = NetworkGradients {
            weights: by.weights,
            inputs: of_seen.as_deref_mut(),
        };
        self.backward_rows(gathered, seen_upstream, [by_output, by_input], by_seen);
        if let (Some(inputs), Some(of_seen)) = (by.inputs, of_seen) {
            for (gradient, &row) in of_seen.chunks_exact(width).zip(&seen) {
                inputs[row * width..(row + 1) * width].copy_from_slice(gradient);
            }
        }
    }

    /// Copies the activations of some rows of a block, in the layout of a block.
    fn gather(&self, block: &[f32], rows: &[usize], out: &mut Vec<f32>) {
        let NetworkShape {
            row_inputs, width, ..
        } = self.shape;
        out.resize(self.shape.block_len(), 0.0);
        let copy = |from: &[f32], to: &mut [f32], width: usize| {
            for (to, &row) in to.chunks_exact_mut(width).zip(rows) {
                to.copy_from_slice(&from[row * width..(row + 1) * width]);
            }
        };
        let (from_inputs, from_hidden) = block.split_at(BLOCK * row_inputs);
        let (to_inputs, to_hidden) = out.split_at_mut(BLOCK * row_inputs);
        copy(from_inputs, to_inputs, row_inputs);
        let layers = from_hidden.chunks_exact(BLOCK * width);
        for (from, to) in layers.zip(to_hidden.chunks_exact_mut(BLOCK * width)) {
            copy(from, to, width);
        }
    }

    fn backward_rows(
        &self,
        block: &[f32],
        upstream: &[f32],
        [by_output, by_input]: [&mut Vec<f32>; 2],
        by: NetworkGradients<'_>,
    ) {
        let (sums, mut by_row_inputs) = (by.weights, by.inputs);
        let width = self.shape.width;
        let rows = upstream.len() / self.shape.outputs;
        let (inputs, hidden) = self.split(block, rows);
        let Some((last, trunk)) = self.layers.split_last() else {
            return;
        };
        if !last.biases().is_empty() {
            sum_columns(upstream, &mut sums[last.biases()]);
        }
        let by_outputs = Factor::new(upstream, last.outputs);
        let last_hidden = Factor::new(hidden[trunk.len() - 1], width);
        multiply_add(
            last_hidden.transposed(),
            by_outputs,
            &mut sums[last.hidden_weights()],
        );
        let weights = Factor::new(&self.weights[last.hidden_weights()], last.outputs);
        multiply(
            by_outputs,
            weights.transposed(),
            &mut by_output[..rows * width],
        );
        for (index, layer) in trunk.iter().enumerate().rev() {
            let gradient = &mut by_output[..rows * width];
            if layer.biases().is_empty() {
                clip(gradient, hidden[index]);
            } else {
                clip_and_sum_columns(gradient, hidden[index], &mut sums[layer.biases()]);
            }
            let by_layer = Factor::new(gradient, width);
            if layer.row_inputs > 0 {
                let inputs = Factor::new(inputs, layer.row_inputs);
                multiply_add(
                    inputs.transposed(),
                    by_layer,
                    &mut sums[layer.row_weights()],
                );
                if let Some(by_row_inputs) = &mut by_row_inputs {
                    let weights = Factor::new(&self.weights[layer.row_weights()], width);
                    multiply_add(by_layer, weights.transposed(), by_row_inputs);
                }
            }
            if layer.hidden_inputs > 0 {
                let previous = Factor::new(hidden[index - 1], width);
                multiply_add(
                    previous.transposed(),
                    by_layer,
                    &mut sums[layer.hidden_weights()],
                );
                let weights = Factor::new(&self.weights[layer.hidden_weights()], width);
                multiply(
                    by_layer,
                    weights.transposed(),
                    &mut by_input[..rows * width],
                );
                std::mem::swap(by_output, by_input);
            }
        }
    }

    /// Computes gradients by weights of shared inputs: each is the bias's gradient times the input.
    fn gradients_by_shared_weights(&self, shared: &[f32], gradients: &mut [f32]) {
        for layer in self.layers.iter().filter(|layer| layer.shared_inputs > 0) {
            let by_bias = gradients[layer.biases()].to_vec();
            let rows = gradients[layer.shared_weights()].chunks_exact_mut(layer.outputs);
            for (row, input) in rows.zip(shared) {
                for (gradient, by_bias) in row.iter_mut().zip(&by_bias) {
                    *gradient = input * by_bias;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
