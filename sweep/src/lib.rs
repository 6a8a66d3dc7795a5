//! Many units of work, on one machine through a local pool and on many through Slurm job arrays.
//!
//! A unit is a short list of idempotent commands. A sweep is a folder:
//!
//! ```text
//! plan.json                     every unit, written once ([`plan`])
//! running.json                  the sweep's runner, which has this file locked
//! units/<id>/running.json       the unit's runner, the same
//! units/<id>/attempt-<n>.log    output of its commands
//! units/<id>/done.json          its outcome ([`folder`]): this or
//! units/<id>/failed.json        this, or neither while it is missing
//! units.csv                     one row per unit, failures included ([`status`])
//! submissions/<n>/              lists of units submitted to Slurm ([`slurm`])
//! ```
//!
//! All state is in these files: a runner ([`pool`]) holds nothing in memory that is lost with it, and its locks end
//! with it. Either one runner works on a sweep, or the tasks of Slurm do, each on its own unit.
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
