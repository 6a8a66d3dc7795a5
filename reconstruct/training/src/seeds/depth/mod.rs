//! Oriented Gaussians at the pixels of views whose distances are known.
//!
//! * [`lift()`]: a view's pixels as flat Gaussians on the surfaces that they show (PanoGS, Eqs. 6 to 8).
//! * [`normals`]: how the surface under each pixel is turned, from as many neighbours as the noise asks for.
//! * [`scales`]: one factor for the distances of each view. [`agreement()`]: which samples other views have
//!   finer, confirm or contradict. [`checks`]: whether distances mean what they are said to mean.
//! * [`source_view`]: a view with its distances, as whatever knows them gives it.
//!
//! Nothing here knows where distances come from: of a sensor, a network or a sweep.

pub mod agreement;
pub mod checks;
pub mod lift;
pub mod normals;
mod pairs;
pub mod scales;
pub mod source_view;

pub use agreement::{Agreement, agreement, sees_past, tolerance};
pub use lift::{DistanceView, LiftCounts, LiftSettings, Lifted, incidence, lift};
pub use scales::{ScaleFit, fit_scales};
pub use source_view::{SourceView, scaled};
