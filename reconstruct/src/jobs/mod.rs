//! Whole commands: they read records, call the rest of the crate, and write records.

pub mod atlas;
pub mod camera_path;
pub mod camera_words;
mod cube_faces;
pub mod edit;
pub mod export;
pub mod interpolate;
mod layer_image;
pub mod plan_cost;
pub mod reconstruct;
pub mod render;
mod render_notes;
mod stage_times;
mod trace_folder;
mod training;
mod unseen;
