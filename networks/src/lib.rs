//! Building blocks of the networks for curation and scoring, on the CPU, without a framework.
//!
//! [`weights`] finds and reads published weights, [`matrix`] multiplies matrices, [`winograd`] turns 3x3 convolutions
//! into matrix products, [`convolution`] convolves images of [`features`], [`mobilenet_v2`] has that network's blocks.
//! Networks themselves are compositions of these in the crates that use them.
//!
//! The reasons against an inference runtime are measurements in `docs/results/boundaries.md`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod convolution;
pub mod features;
pub mod matrix;
pub mod mobilenet_v2;
pub mod packed_matrix;
pub mod weights;
pub mod winograd;

pub use convolution::{Convolution, Kernel};
pub use features::Features;
pub use matrix::Matrix;
pub use packed_matrix::{LeftFactor, PackedMatrix};
pub use weights::{Weights, WeightsError};
