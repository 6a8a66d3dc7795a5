//! The binary from outside: what it prints, what it leaves on disk, and how it fails.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

#[cfg(unix)]
mod adapters;
mod assets;
mod atlas;
mod bad_input;
#[cfg(unix)]
mod benchmark;
#[cfg(unix)]
mod curation;
#[cfg(unix)]
mod foreign_files;
mod full_disk;
mod geometry;
mod help;
mod interruption;
#[cfg(unix)]
mod ledger;
mod main_job;
#[cfg(unix)]
mod many_videos;
mod output;
mod rendering;
mod splatters;
mod stages;
mod submissions;
mod support;
#[cfg(unix)]
mod sweeps;
mod two_at_once;
