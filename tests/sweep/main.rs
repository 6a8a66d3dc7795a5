//! Sweeps: plans, pools of killed runners, and job arrays on a real Slurm.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod pool;
mod slurm;
mod support;
