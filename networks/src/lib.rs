//! What the networks of curation and scoring are built from, on the CPU, without a framework.
//!
//! [`weights`] finds and reads published weights, [`matrix`] multiplies matrices, [`winograd`]
//! turns 3x3 convolutions into matrix products, [`convolution`] convolves images of
//! [`features`], [`mobilenet_v2`] has that network's blocks. A network itself lies where it is used, as a composition of these.
//!
//! Why no inference runtime: `docs/results/boundaries.md` has the measurements.
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
