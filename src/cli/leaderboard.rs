//! `omnilife leaderboard`.

use std::path::PathBuf;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub(crate) enum LeaderboardCommand {
    /// Makes table.md and table.csv from all results in a folder.
    Build {
        /// Folder that is searched for result.json files.
        results: PathBuf,
        /// Folder of the tables.
        #[arg(long)]
        out: PathBuf,
    },
}
