//! From scores to tables.
//!
//! [`collect`] finds the `result.json` files of a folder; [`build`] makes one table per protocol,
//! in Markdown for people and CSV for programs. Images are never read here.

mod collect;
mod csv_table;
pub mod error;
mod format;
mod markdown_table;
mod ranking;
mod tables;

pub use collect::collect;
pub use error::LeaderboardError;
pub use tables::{CSV_FILE, MARKDOWN_FILE, Tables, build};
