//! Aids: components that help any method whose Gaussians can have them.
//!
//! They belong neither to a published method nor to one of this project. Scores compare methods only where both use
//! the same aids. So methods of one class have the same aids by default, and records of runs say which they used.
//!
//! [`ALL`] in a request stands for all of them. `--without aids` leaves them out: the bare method. `--with aids` lets
//! the evidence decide on the optional ones too; those of [`BY_NAME`] stay out.

/// Name of all aids together in a request.
pub const ALL: &str = "aids";

/// The aids, by the names of their components.
pub const AIDS: &[&str] = &[
    "exposure-compensation",
    "camera-response",
    "view-dependent-colour",
    "pose-refinement",
    "short-schedule",
    "dropout",
    "denser-points",
    "mask-seeds",
    "static-table",
];

/// Aids that no evidence decides on: used where they are asked for by name.
pub const BY_NAME: &[&str] = &["camera-response"];

/// Returns true for an aid.
pub fn is_aid(component: &str) -> bool {
    AIDS.contains(&component)
}
