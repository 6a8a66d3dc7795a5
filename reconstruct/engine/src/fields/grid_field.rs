//! A hash grid followed by a network: a field over the unit square or cube.
//!
//! The network has no biases and its output layer starts at zero, so that the field is exactly 0 until it is
//! trained. Neural Atlas Graphs subtracts the untrained network's mean instead.

pub(crate) mod gpu;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    hash_grid::{HashGrid, HashGridShape},
    mlp::{
        network::NetworkShape,
        passes::{Activations, NetworkGradients},
    },
};
use crate::parameters::{ParameterArray, SharedParameters, adam};

/// Initial values of the table are drawn between this and its negative (tiny-cuda-nn).
const FIRST_FEATURES: f32 = 1e-4;

/// Sizes of a field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GridFieldShape {
    /// The grid.
    pub grid: HashGridShape,
    /// Hidden layers of the network.
    pub hidden_layers: usize,
    /// Width of each hidden layer.
    pub width: usize,
    /// Outputs of the field.
    pub outputs: usize,
}

impl GridFieldShape {
    /// Returns the sizes of its network.
    pub fn network(&self) -> NetworkShape {
        NetworkShape {
            row_inputs: 4 * self.grid.levels,
            shared_inputs: 0,
            depth: self.hidden_layers,
            width: self.width,
            skip_after: None,
            has_biases: false,
            outputs: self.outputs,
        }
    }

    /// Returns the number of values of table and network.
    pub fn parameter_count(&self) -> usize {
        HashGrid::new(self.grid).parameter_count() + self.network().weight_count()
    }
}

/// A field with its parameters, and the state of its last evaluation for the backward pass.
#[derive(Debug)]
pub struct GridField {
    shape: GridFieldShape,
    grid: HashGrid,
    network: NetworkShape,
    /// Features of the grid's entries.
    pub table: SharedParameters,
    /// Weights of the network.
    pub weights: SharedParameters,
    activations: Activations,
    positions: Vec<f32>,
    active: usize,
    by_features: Vec<f32>,
}

impl GridField {
    /// Creates a field that is 0 everywhere.
    pub fn new(shape: GridFieldShape, seed: u64) -> Self {
        let grid = HashGrid::new(shape.grid);
        let network = shape.network();
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut table = vec![0.0; grid.parameter_count()];
        table.fill_with(|| random.random_range(-FIRST_FEATURES..=FIRST_FEATURES));
        let mut weights = vec![0.0; network.weight_count()];
        for layer in network.layers().iter().take(network.depth) {
            // Glorot and Bengio 2010, uniform.
            let bound = (6.0 / (layer.inputs() + layer.outputs) as f32).sqrt();
            let range = layer.hidden_weights().start..layer.row_weights().end;
            weights[range].fill_with(|| random.random_range(-bound..=bound));
        }
        Self::with_parameters(shape, table, weights)
    }

    /// Creates a field with these features and weights.
    ///
    /// # Panics
    /// If their numbers do not match the sizes.
    pub fn with_parameters(shape: GridFieldShape, table: Vec<f32>, weights: Vec<f32>) -> Self {
        let grid = HashGrid::new(shape.grid);
        let network = shape.network();
        assert_eq!(table.len(), grid.parameter_count(), "features");
        assert_eq!(weights.len(), network.weight_count(), "weights");
        Self {
            shape,
            active: grid.features(),
            grid,
            network,
            table: SharedParameters::new("features", table),
            weights: SharedParameters::new("weights", weights),
            activations: Activations::new(usize::MAX),
            positions: Vec::new(),
            by_features: Vec::new(),
        }
    }

    /// Returns the sizes.
    pub fn shape(&self) -> &GridFieldShape {
        &self.shape
    }

    /// Returns the number of features of the grid.
    pub fn features(&self) -> usize {
        self.grid.features()
    }

    /// Returns table and weights.
    pub fn arrays(&self) -> [&ParameterArray; 2] {
        [&self.table.array, &self.weights.array]
    }

    /// Returns the outputs (rows of `outputs`) at positions (rows of `dimensions`). Only the first `active`
    /// features of the grid are used, the others are 0. Keeps the state that [`GridField::backward`] needs.
    pub fn forward(&mut self, positions: &[f32], active: usize) -> Vec<f32> {
        self.positions.clear();
        self.positions.extend_from_slice(positions);
        self.active = active;
        let rows = positions.len() / self.shape.grid.dimensions;
        let mut out = vec![0.0; rows * self.shape.outputs];
        let (grid, table) = (&self.grid, &self.table.array.values);
        let dimensions = self.shape.grid.dimensions;
        let encode = |row: usize, features: &mut [f32]| {
            let position = &positions[row * dimensions..(row + 1) * dimensions];
            grid.encode(position, table, active, features);
        };
        let weights = &self.weights.array.values;
        self.network
            .forward(weights, &[], &encode, &mut self.activations, &mut out);
        out
    }

    /// Returns the outputs as [`GridField::forward`] does, but keeps no state.
    pub fn evaluate(&self, positions: &[f32], active: usize) -> Vec<f32> {
        let dimensions = self.shape.grid.dimensions;
        let rows = positions.len() / dimensions;
        let mut out = vec![0.0; rows * self.shape.outputs];
        let (grid, table) = (&self.grid, &self.table.array.values);
        let encode = |row: usize, features: &mut [f32]| {
            let position = &positions[row * dimensions..(row + 1) * dimensions];
            grid.encode(position, table, active, features);
        };
        let mut nothing = Activations::new(0);
        let weights = &self.weights.array.values;
        self.network
            .forward(weights, &[], &encode, &mut nothing, &mut out);
        out
    }

    /// Computes gradients by table and weights from those by the outputs of the last [`GridField::forward`],
    /// in its shape; returns those by the positions, in theirs.
    pub fn backward(&mut self, upstream: &[f32]) -> Vec<f32> {
        let dimensions = self.shape.grid.dimensions;
        let features = self.grid.features();
        let Self {
            grid,
            network,
            table,
            weights,
            activations,
            positions,
            active,
            by_features,
            ..
        } = self;
        let rows = positions.len() / dimensions;
        by_features.resize(rows * features, 0.0);
        let encode = |row: usize, out: &mut [f32]| {
            let position = &positions[row * dimensions..(row + 1) * dimensions];
            grid.encode(position, &table.array.values, *active, out);
        };
        let by = NetworkGradients {
            weights: &mut weights.array.gradients,
            inputs: Some(by_features),
        };
        network.backward(
            &weights.array.values,
            &[],
            &encode,
            activations,
            upstream,
            by,
        );
        grid.backward_table(positions, *active, by_features, &mut table.array.gradients);
        let mut by_positions = vec![0.0; positions.len()];
        let (values, active) = (&table.array.values, *active);
        by_positions
            .par_chunks_mut(dimensions)
            .zip(positions.par_chunks(dimensions))
            .zip(by_features.par_chunks(features))
            .for_each(|((gradient, position), upstream)| {
                grid.backward_position(position, values, active, upstream, gradient);
            });
        by_positions
    }

    /// Takes one step of Adam with these learning rates of table and weights; returns the number of gradients
    /// that were not finite.
    pub fn step(&mut self, [table_rate, weight_rate]: [f32; 2]) -> usize {
        let parts = [
            (&mut self.table, table_rate),
            (&mut self.weights, weight_rate),
        ];
        parts
            .into_iter()
            .map(|(parameters, rate)| {
                parameters.array.learning_rate = rate;
                parameters.steps += 1;
                adam::cpu::step(
                    &mut parameters.array,
                    parameters.steps,
                    adam::SecondMomentDecay::PUBLISHED,
                )
            })
            .sum()
    }
}
