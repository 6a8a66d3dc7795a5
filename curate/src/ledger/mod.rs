//! The boundary ledger: statements of authors on the boundaries of a video, and their resolution.
//!
//! `ledger.jsonl` in a video's folder holds one [`omnilife_schemas::records::LedgerEntry`] per line and only ever
//! grows. Detectors and annotators propose boundaries, experts accept, reject, move and add ([`Ledger::append`]).
//! [`resolve()`] derives the boundaries in force, and [`agreement`] the agreement between authors. People also label
//! segments ([`labels`]). [`formats`] reads and writes formats of other tools.

pub mod agreement;
mod check;
mod file;
pub mod formats;
pub mod labels;
pub mod merge;
pub mod resolve;

pub use file::{Ledger, Statement};
pub use merge::{Evidence, MergeRequest, Role, export, merge, of_video};
pub use resolve::{Candidate, Status, candidates, resolve};

use omnilife_schemas::records::Boundary;

/// Seconds between the nearest instants of two boundaries; 0 where they overlap.
pub fn gap_seconds(a: &Boundary, b: &Boundary) -> f64 {
    (a.begin_seconds - b.end_seconds)
        .max(b.begin_seconds - a.end_seconds)
        .max(0.0)
}
