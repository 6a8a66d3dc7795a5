//! Rigid motion in time: positions and rotations between knots, and their gradients.
//!
//! * [`catmull_rom`]: positions. [`rotation_spline`]: rotations. [`rigid_spline`]: both, as a given trajectory
//!   with trained offsets.
//! * [`rigid_path`]: a given path on the ground with trained corrections.
//! * `dual`: numbers with derivatives.

pub mod catmull_rom;
mod dual;
pub mod rigid_path;
pub mod rigid_spline;
pub mod rotation_spline;

#[cfg(test)]
mod tests;
