//! `sweep-plan`, `unit-outcome`, `runner-lock`: many units of work, and the outcome of each.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{stage::StageOutput, store::Record};

/// `plan.json` of a sweep: every unit of work, written once and never changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SweepPlan {
    /// Version of the program that planned.
    pub version: String,
    /// Absolute path of the folder in which all commands run.
    pub folder: String,
    /// The units, in the order in which they start.
    pub units: Vec<SweepUnit>,
    /// Commands that make one whole of what the units leave, run one after another.
    pub reduce: Vec<Vec<String>>,
    /// SHA-256 of everything above, as JSON.
    pub sha256: String,
}

impl Record for SweepPlan {
    const SCHEMA: &'static str = "omnilife/sweep-plan/1";
}

/// One unit of work: idempotent commands, of which the program `omnilife` is this one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SweepUnit {
    /// Name, unique in the plan: letters, digits, `.`, `-`, `_`.
    pub id: String,
    /// Units of one group cost about the same: what some have cost is what others will need.
    pub group: String,
    /// Labels for tables: method, scene, seed ...
    pub labels: BTreeMap<String, String>,
    /// Programs with their arguments, run one after another until one fails.
    pub commands: Vec<Vec<String>>,
    /// Commands that [`SweepPlan::reduce`] is preceded by where the unit failed: they leave a
    /// record of the failure. `{reason}` in an argument stands for the reason.
    pub on_failure: Vec<Vec<String>>,
    /// Files whose content it depends on.
    pub inputs: Vec<String>,
    /// Files that stand when it is done.
    pub outputs: Vec<String>,
    /// Expected needs, until a unit of its group is measured.
    pub needs: UnitNeeds,
}

/// Needs of a unit on its machine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UnitNeeds {
    /// CPU cores; its commands are told to use as many threads.
    pub cores: u32,
    /// Resident memory, bytes.
    pub memory_bytes: u64,
    /// GPUs.
    pub gpus: u32,
    /// Wall-clock seconds after which it is ended and has failed; `None` sets no limit.
    pub limit_seconds: Option<f64>,
}

/// `done.json` or `failed.json` in a unit's folder: how its last attempt ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UnitOutcome {
    /// Id of the unit.
    pub unit: String,
    /// Why it failed, in one line; `None` where it is done.
    pub failure: Option<String>,
    /// Exit code of the command that failed, where it had one.
    pub exit_code: Option<i32>,
    /// SHA-256 of the unit as planned and the program's version.
    pub unit_sha256: String,
    /// Its inputs as they were when it began.
    pub inputs: Vec<UnitInput>,
    /// Its outputs with their sizes; none where it failed.
    pub outputs: Vec<StageOutput>,
    /// Number of this attempt, from 1.
    pub attempt: u32,
    /// Process that ran it.
    pub runner: UnitRunner,
    /// When it began, seconds since 1970 by the runner's clock.
    pub begun_unix_seconds: f64,
    /// Wall-clock time, seconds.
    pub wall_seconds: f64,
    /// CPU time, seconds, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Highest resident memory of one of its processes, bytes, where the system tells.
    pub peak_memory_bytes: Option<u64>,
    /// Everything its commands printed, in the unit's folder.
    pub log: String,
    /// Processes that ran on when its commands had ended, in words: `sleep (process 4711)`. All were
    /// ended but for those that say that they could not be; records of older versions have none.
    #[serde(default)]
    pub left_running: Vec<String>,
}

impl Record for UnitOutcome {
    const SCHEMA: &'static str = "omnilife/unit-outcome/1";
}

/// A file that a unit depends on; a scene with the images, masks, points and other files that it names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct UnitInput {
    /// Path as planned.
    pub file: String,
    /// Size in bytes, of all of a scene.
    pub bytes: u64,
    /// Time of the last change of its entry in the file system, nanoseconds since 1970; for a scene a number of the sizes
    /// and times of all of its files in their order. While this and the size stay, it is not hashed again.
    pub modified_nanoseconds: u64,
    /// SHA-256 of its content; of a scene that of the hashes of its files.
    pub sha256: String,
}

/// A process that runs units.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct UnitRunner {
    /// Name of its machine.
    pub host: String,
    /// Its process id.
    pub process: u32,
    /// The Slurm job, `<array>_<task>` or `<job>`, where it is one.
    pub slurm_job: Option<String>,
}

/// `running.json` in the folder of a unit or of a sweep: who holds the lock on this file, or held it
/// last and went away.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunnerLock {
    /// Process that holds the lock.
    pub runner: UnitRunner,
    /// Runners that held it before, one after another, and went away.
    pub lost_runners: u32,
}

impl Record for RunnerLock {
    const SCHEMA: &'static str = "omnilife/runner-lock/1";
}
