//! Choice of the best hypothesis of distance for each pixel of an image, for any kind of hypothesis: a sphere about the
//! camera (`omnilife-training`), a plane before it (`omnilife-curate`).
//!
//! ```text
//! cost       dissimilarity of an image and another one warped onto its grid
//! aggregate  semi-global smoothing of the costs of all hypotheses
//! minimum    the best hypothesis, to a fraction of a step
//! ```
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod aggregate;
mod cost;
mod minimum;

pub use aggregate::{PathSums, aggregated};
pub use cost::{CostVolume, LARGEST_COST, Matcher, UNKNOWN_COST};
pub use minimum::{BestHypothesis, best};

/// Boundary condition at the ends of an image's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowEnds {
    /// The row is a circle: beyond its end is its start.
    Joined,
    /// Nothing lies beyond.
    Open,
}
