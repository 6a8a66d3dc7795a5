//! `omnilife leaderboard`.

use crate::{cli::LeaderboardCommand, exit};

pub(crate) fn execute(command: &LeaderboardCommand) -> anyhow::Result<()> {
    match command {
        LeaderboardCommand::Build { results, out } => {
            let found = omnilife_leaderboard::collect(results)?;
            let tables = omnilife_leaderboard::build(&found, out)?;
            exit::print(&tables.markdown)
        }
    }
}
