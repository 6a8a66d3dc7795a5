//! Whole commands: they read records, call the rest of the crate, and write records.

pub mod edit;
pub mod interpolate;
pub mod plan_cost;
pub mod reconstruct;
pub mod render;
