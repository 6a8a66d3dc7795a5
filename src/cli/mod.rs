//! The command line: one file per command group.

mod bench;
mod curate;
mod leaderboard;
mod reconstruct;
mod run;

pub(crate) use bench::BenchCommand;
use clap::{Parser, Subcommand};
pub(crate) use curate::{CurateCommand, LedgerCommand};
pub(crate) use leaderboard::LeaderboardCommand;
pub(crate) use reconstruct::ReconstructCommand;
pub(crate) use run::RunArguments;

/// Curate 360-degree video, reconstruct it and score it against the OmniLife360 protocol.
#[derive(Debug, Parser)]
#[command(name = "omnilife", version, max_term_width = 100)]
pub(crate) struct Cli {
    /// Prints errors and results only.
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The main job: from raw 360-degree videos to a scored table.
    // The last of repeated options counts: scripts put their defaults first.
    #[command(args_override_self = true)]
    Run(RunArguments),
    /// Raw video to verified, cut and posed sequences.
    #[command(subcommand)]
    Curate(CurateCommand),
    /// A posed scene to Gaussians and rendered views.
    #[command(subcommand)]
    Reconstruct(ReconstructCommand),
    /// Splits and scores.
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Scores to tables.
    #[command(subcommand)]
    Leaderboard(LeaderboardCommand),
    /// What is installed, and what each missing thing would enable.
    Doctor,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_last_of_repeated_options_counts() {
        let words = "omnilife run a.mp4 --out o --iterations 1 --iterations 2";
        let cli = Cli::try_parse_from(words.split(' ')).map(|cli| cli.command);
        assert!(
            matches!(&cli, Ok(Command::Run(run)) if run.iterations == 2),
            "{cli:?}"
        );
    }
}
