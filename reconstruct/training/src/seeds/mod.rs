//! First Gaussians.
//!
//! * [`points`]: at the points of a scene; [`swept`]: points for a scene without any. [`depth`]: at pixels
//!   whose distances are known. [`sky`]: in the directions without any. [`masks`]: where masks show that
//!   something moves.

pub mod depth;
pub mod masks;
pub mod points;
pub mod sky;
pub mod swept;
