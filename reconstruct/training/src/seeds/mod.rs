//! First Gaussians.
//!
//! * [`points`]: at the points of a scene; [`swept`]: points for a scene without points. [`depth`]: at pixels of
//!   known distance. [`sky`]: in the directions without points. [`masks`]: on masked pixels.

pub mod depth;
pub mod masks;
pub mod points;
pub mod sky;
pub mod swept;
