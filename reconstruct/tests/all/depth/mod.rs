//! Distances: lifting them, what views say of each other's, and the method that begins with them.

mod lift;
mod panogs;
mod room;
mod shards;
mod views;
