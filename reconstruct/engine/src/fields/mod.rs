//! Functions of position and time that are learnt.
//!
//! * [`mlp`]: networks. [`hash_grid`]: features read from tables. [`grid_field`]: both, one behind the
//!   other.

pub mod grid_field;
pub mod hash_grid;
pub mod mlp;
