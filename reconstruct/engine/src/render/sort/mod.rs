//! Sorting: visible splats from near to far by radial distance, ties by Gaussian index.

pub mod cpu;
pub(crate) mod gpu;
