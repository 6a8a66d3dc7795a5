//! Learned functions of position and time.
//!
//! * [`mlp`]: networks. [`hash_grid`]: features read from tables. [`grid_field`]: a grid followed by a network.

pub mod grid_field;
pub mod hash_grid;
pub mod mlp;
