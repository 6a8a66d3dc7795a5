//! Multilayer perceptron, evaluated for every Gaussian in every training step.
//!
//! * [`encoding`]: positional encoding of its inputs.
//! * [`network`]: its layers and their weights; [`passes`]: forward and backward, block by block.
//! * `product`: matrix products.
//! * [`mod@reference`]: the definition in f64, the reference for tests and the stability catalogue.
//! * `gpu`, `product_gpu`, `blocks_gpu`: the same on a GPU.

pub(crate) mod blocks_gpu;
#[cfg(test)]
mod cases;
pub mod encoding;
pub(crate) mod gpu;
pub mod network;
pub mod passes;
mod product;
pub(crate) mod product_gpu;
pub mod reference;
