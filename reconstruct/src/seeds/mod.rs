//! First Gaussians.
//!
//! * [`points`]: at the points of a scene. [`sky`]: in the directions without any. [`masks`]: where masks
//!   show that something moves.

pub mod masks;
pub mod points;
pub mod sky;
