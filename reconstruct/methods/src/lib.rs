//! Reconstruction methods: one file or folder each, with its row in `METHOD`.
//!
//! All but those of [`feed_forward`] train Gaussians.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod deformable;
mod dynamic;
pub mod feed_forward;
pub mod object_graph;
pub mod odgs;
pub mod odgs_published;
pub mod omni4dgs;
pub mod omni4dgs_plus;
pub mod panogs;
pub mod periodic;
mod tracked_objects;
