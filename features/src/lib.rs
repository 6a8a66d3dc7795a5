//! Features of third-party crates that all crates of the workspace share.
//!
//! A crate that is built alone would otherwise have dependencies with fewer features than within the workspace, and they
//! would be compiled once more.
