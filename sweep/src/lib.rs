//! Many units of work, on one machine through a local pool and on many through Slurm job arrays.
//!
//! A unit is a short list of idempotent commands. A sweep is a folder:
//!
//! ```text
//! plan.json                     every unit, written once ([`plan`])
//! running.json                  who runs it, and has this file locked
//! units/<id>/running.json       who works on the unit, the same
//! units/<id>/attempt-<n>.log    what its commands printed
//! units/<id>/done.json          how it ended ([`folder`]): this or
//! units/<id>/failed.json        this, or neither while it is missing
//! units.csv                     one row per unit, failures included ([`status`])
//! submissions/<n>/              lists of units that were handed to Slurm ([`slurm`])
//! ```
//!
//! What is true is in these files alone: a runner ([`pool`]) holds nothing in memory that is lost with
//! it, and its locks end with it. One runner works on a sweep, or the tasks of Slurm do, each on the
//! unit that it was given.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod error;
pub mod folder;
pub mod history;
mod host;
mod lock;
pub mod plan;
pub mod pool;
mod process;
pub mod reduce;
pub mod slurm;
pub mod status;
mod unit;

pub use error::SweepError;
pub use folder::{Sweep, UnitState};
pub use pool::{PoolLimits, RunRequest, RunSummary, run};
