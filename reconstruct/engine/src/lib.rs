//! Differentiable rendering of Gaussians, and optimization of their parameters.
//!
//! This crate knows nothing of scene files, methods, plans or reports. Its modules, from the top down (each
//! imports only from those below it, which a test checks):
//!
//! * [`step`]: one training step on one view, on the CPU or a GPU.
//! * [`density`]: cloning, splitting, pruning and reordering of Gaussians.
//! * [`model`]: the trained parameters and their layers.
//! * [`render`]: project, sort, bin, raster; [`losses`]: training losses.
//! * [`gaussians`]: one file per parameterization, from raw parameters to activated Gaussians.
//! * [`surfaces`]: textured planes and the sphere, ray intersections, layers.
//! * [`trajectories`]: rigid motion between knots. [`fields`]: networks and hash grids. [`parameters`]:
//!   tables, Adam.
//! * [`camera`]: Jacobians and VJPs. [`device`]: a GPU. [`clock`], [`schedule`], [`training_view`].
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod camera;
pub mod clock;
pub mod density;
pub mod device;
pub mod error;
pub mod fields;
pub mod gaussians;
#[cfg(test)]
mod golden_tests;
pub mod kernels;
pub mod losses;
pub mod model;
pub mod parameters;
pub mod render;
pub mod schedule;
pub mod step;
pub mod surfaces;
pub mod training_view;
pub mod trajectories;

pub use error::EngineError;
