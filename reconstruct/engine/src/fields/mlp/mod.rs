//! A multilayer perceptron that every Gaussian goes through in every training step.
//!
//! * [`encoding`]: positional encoding of its inputs.
//! * [`network`]: its layers and their weights; [`passes`]: forward and backward, block by block.
//! * `product`: matrix products.
//! * [`mod@reference`]: the definition in f64, that tests and the stability catalogue judge by.
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
