//! A multilayer perceptron that every Gaussian goes through in every training step.
//!
//! * [`encoding`]: positional encoding of its inputs.
//! * [`network`]: its layers and their weights; [`passes`]: forward and backward, block by block.
//! * `product`: matrix products.

pub mod encoding;
pub mod network;
pub mod passes;
mod product;
