//! Renders Gaussians, differentiates the renders and optimizes what made them.
//!
//! This crate knows no scene file, no method, no plan and no report. Its modules, from the top down (each
//! imports only from those below it; a test holds that):
//!
//! * [`step`]: one training step on one view, on the CPU or a GPU.
//! * [`density`]: when Gaussians are cloned, split, pruned and reordered.
//! * [`model`]: what training changes, and its layers.
//! * [`render`]: project, sort, bin, raster; [`losses`]: what renders are held to.
//! * [`gaussians`]: one file per parameterization, from raw parameters to what a renderer sees.
//! * [`surfaces`]: textured planes and the sphere, rays that hit them, layers.
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
