//! Distances: their lift, the agreement of views, and the method that starts with them.

mod lift;
pub(crate) mod panogs;
pub(crate) mod room;
mod shards;
mod sky;
mod views;
