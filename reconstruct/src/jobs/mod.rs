//! Whole commands: they read records, call the rest of the crate, and write records.

pub mod atlas;
mod cube_faces;
pub mod edit;
pub mod edit_objects;
pub mod export;
pub mod interpolate;
mod opened_gaussians;
pub mod plan_cost;
pub mod reconstruct;
pub mod render;
mod run_views;
mod stage_times;
mod trace_folder;
