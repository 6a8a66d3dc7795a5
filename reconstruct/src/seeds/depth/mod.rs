//! Oriented Gaussians at the pixels of views whose distances are known.
//!
//! * [`lift`]: a view's pixels as flat Gaussians on the surfaces that they show (PanoGS, Eqs. 6 to 8).
//! * [`normals`]: how the surface under each pixel is turned, from as many neighbours as the noise asks for.
//!
//! Nothing here knows where distances come from: of a sensor, a network or a sweep.

pub mod lift;
pub mod normals;

pub use lift::{DistanceView, LiftCounts, LiftSettings, Lifted, lift};
