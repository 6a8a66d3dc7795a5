//! Distances: their lift, the agreement of views, and the method that starts with them.

mod lift;
mod panogs;
mod room;
mod shards;
mod sky;
mod views;
