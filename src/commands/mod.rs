//! Stages of the main job as commands of their own.

mod ablate;
mod attach;
pub(crate) mod bench;
mod bench_poses;
mod bench_run;
mod bench_scores;
mod bench_stability;
pub(crate) mod curate;
pub(crate) mod dataset;
mod edit;
pub(crate) mod leaderboard;
mod ledger;
pub(crate) mod method_list;
mod pooled;
pub(crate) mod reconstruct;
mod road_table;
mod submission;
pub(crate) mod sweep;
mod video;

use std::{
    io::{self, Write},
    path::Path,
};

use anyhow::bail;
use clap_complete::Shell;
use omnilife_schemas::{progress::Progress, records::Scene, store};

use crate::{cli, doctor, exit};

/// Reports the frames of a scene whose cameras are far from all others.
fn note_far_frames(scene: &Path, progress: &dyn Progress) -> anyhow::Result<()> {
    let scene: Scene = store::read_record(scene)?;
    if let Some(line) = scene.far_frames() {
        progress.note(&line);
    }
    Ok(())
}

/// Runs `omnilife completions`.
pub(crate) fn completions(shell: Shell) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(
        shell,
        &mut cli::command_with_values(),
        "omnilife",
        &mut script,
    );
    Ok(io::stdout().write_all(&script)?)
}

/// Runs `omnilife doctor`.
pub(crate) fn doctor(as_json: bool) -> anyhow::Result<()> {
    let report = doctor::report();
    if as_json {
        curate::print_json(&report)?;
    } else {
        exit::print(&report.to_string())?;
    }
    if !report.is_sound() {
        bail!("something that the main job needs is missing");
    }
    Ok(())
}
