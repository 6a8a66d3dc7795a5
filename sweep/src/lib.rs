//! Many units of work, on one machine through a local pool and on many through Slurm job arrays.
//!
//! A unit is a short list of idempotent commands. A sweep is a folder:
//!
//! ```text
//! plan.json                     every unit, written once ([`plan`])
//! units/<id>/claim-<n>.json     who works on it ([`claim`])
//! units/<id>/attempt-<n>.log    what its commands printed
//! units/<id>/done.json          how it ended ([`folder`]): this or
//! units/<id>/failed.json        this, or neither while it is missing
//! units.csv                     one row per unit, failures included ([`status`])
//! submissions/<n>/              lists of units that were handed to Slurm ([`slurm`])
//! ```
//!
//! What is true is in these files alone: runners ([`pool`]) hold nothing in memory that is lost with
//! them, and any number of them may work on one sweep.

pub mod claim;
pub mod error;
pub mod folder;
pub mod history;
mod host;
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
