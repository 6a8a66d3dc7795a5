//! Oriented Gaussians at the pixels of views whose distances are known.
//!
//! * [`lift()`]: a view's pixels as flat Gaussians on their surfaces (PanoGS, Eqs. 6 to 8).
//! * [`normals`]: orientation of the surface under each pixel, from as many neighbours as the noise requires.
//! * [`scales`]: one factor for the distances of each view. [`agreement()`]: finer, confirming and contradicting
//!   samples of other views. [`checks`]: checks of the distances' meaning, [`units`] of their unit.
//! * [`source_view`]: a view with its distances, from any source. [`sources`]: files of distances, or the sphere sweep.
//!
//! All of it is independent of the source of distances: a sensor, a network or a sweep.

pub mod agreement;
pub mod checks;
pub mod lift;
pub mod normals;
mod pairs;
pub mod scales;
pub mod source_view;
pub mod sources;
pub mod units;

pub use agreement::{Agreement, agreement, sees_past, tolerance};
pub use lift::{DistanceView, LiftCounts, LiftSettings, SurfaceSamples, incidence, lift};
pub use scales::{ScaleFit, fit_scales};
pub use source_view::{SourceView, scaled};
