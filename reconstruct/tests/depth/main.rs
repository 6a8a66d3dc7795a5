//! Distances: lifting them, what views say of each other's, and the method that begins with them.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod lift;
mod panogs;
mod room;
mod shards;
mod views;
