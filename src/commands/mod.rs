//! The stages of the main job as commands of their own.

mod ablate;
pub(crate) mod bench;
mod bench_run;
mod bench_scores;
mod bench_stability;
pub(crate) mod curate;
pub(crate) mod dataset;
pub(crate) mod leaderboard;
mod ledger;
pub(crate) mod reconstruct;
mod submission;
pub(crate) mod sweep;
mod video;

use anyhow::bail;

use crate::{doctor, exit};

/// `omnilife doctor`.
pub(crate) fn doctor() -> anyhow::Result<()> {
    let report = doctor::report();
    exit::print(&report.to_string())?;
    if !report.is_sound() {
        bail!("something that the main job needs is missing");
    }
    Ok(())
}
