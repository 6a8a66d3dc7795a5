//! Training losses.
//!
//! * [`photometric`]: L1 and SSIM against an image, continuous across the seam.
//! * [`maps`]: velocities, opacities and lifespans rendered as maps. [`motion`]: velocities of
//!   Gaussians themselves.

pub mod maps;
pub mod motion;
pub mod photometric;
pub mod scaffold;
