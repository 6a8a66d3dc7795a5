//! First Gaussians.
//!
//! * [`points`]: at the points of a scene, and in the sky. [`masks`]: where masks show that something
//!   moves.

pub mod masks;
pub mod points;
