//! The boundary ledger: who said what about the boundaries of a video, and what follows.
//!
//! `ledger.jsonl` in a video's folder holds one [`omnilife_schemas::records::LedgerEntry`] per line and only ever grows.
//! Detectors and annotators propose boundaries, experts accept, reject, move and add
//! ([`Ledger::append`]); [`resolve()`] says which boundaries hold, and [`agreement`] how far the
//! authors agree. People also label segments ([`labels`]). [`formats`] reads and writes what other
//! tools use.

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
