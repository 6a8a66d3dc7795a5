//! The command line: one file per command group.

mod attach;
mod bench;
mod bench_run;
mod camera_words;
mod curate;
mod dataset;
mod edit;
mod guide;
mod leaderboard;
mod ledger;
mod memory;
mod numbers;
mod places;
mod poses;
mod reconstruct;
#[cfg(test)]
mod reference;
mod run;
mod statement;
mod suggestion;
mod sweep;
mod tracks;
#[cfg(test)]
mod walk;

pub(crate) use attach::AttachArguments;
pub(crate) use bench::BenchCommand;
pub(crate) use bench_run::{AidsArgument, BenchRunArguments};
use clap::{ColorChoice, Command as ClapCommand, FromArgMatches, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
pub(crate) use curate::{
    BuildArguments, CurateArguments, CurateCommand, CurationSettingsArguments, MemoryLimitArguments,
};
pub(crate) use dataset::{
    AnnotateArguments, ExportArguments, ImportArguments, MasksArguments, PublishArguments,
    SelectArguments, SliceArguments,
};
pub(crate) use edit::EditArguments;
pub(crate) use leaderboard::{
    AddArguments, AnswerFormatArgument, DatasetsArguments, FigureArguments, GalleryArguments,
    LeaderboardBuildArguments, LeaderboardCommand, QueryArguments, SubmitResultsArguments,
};
pub(crate) use ledger::LedgerCommand;
pub(crate) use reconstruct::{
    AssetArguments, BackendArgument, CameraArgument, MethodArguments, ReconstructCommand,
    RenderArguments, plan_word,
};
pub(crate) use run::{MaskStepArgument, MaskStepArguments, RunArguments};
pub(crate) use suggestion::tip_for_video;
pub(crate) use sweep::{
    BenchPlanArguments, PlanArguments, PlanCommand, SubmitArguments, SweepCommand,
    SweepRunArguments,
};
pub(crate) use tracks::TrackArguments;

use crate::colour;

/// Curate 360-degree video, reconstruct it and score it against the OmniLife360 protocol.
#[derive(Debug, Parser)]
#[command(name = "omnilife", version = env!("OMNILIFE_VERSION"), max_term_width = 100)]
pub(crate) struct Cli {
    /// Prints errors and results only.
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    /// Shows progress as bars or lines, or writes it as JSON for other programs, an object per line of
    /// standard error.
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value_t = ProgressArgument::Auto)]
    pub(crate) progress: ProgressArgument,
    /// Shows errors, warnings and best values in colour; auto does on a terminal, unless `NO_COLOR` is set.
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = ColorChoice::Auto)]
    color: ColorChoice,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The formats of progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressArgument {
    Auto,
    Json,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Does everything: from raw 360-degree videos to a table of scores.
    // The last of repeated options counts: scripts put their defaults first.
    #[command(args_override_self = true)]
    Run(Box<RunArguments>),
    /// Makes verified, cut and posed sequences of raw video.
    Curate(CurateArguments),
    /// Trains Gaussians on a posed scene, and renders, edits and exports them.
    #[command(subcommand)]
    Reconstruct(ReconstructCommand),
    /// Splits scenes and scores predictions.
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Makes tables, figures and a site of scores.
    #[command(subcommand)]
    Leaderboard(LeaderboardCommand),
    /// Runs many videos, or many methods, scenes and seeds: on this machine, or on a Slurm cluster.
    #[command(subcommand)]
    Sweep(SweepCommand),
    /// Prints completions for a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Prints which dependencies are installed, and which features each missing one would enable.
    Doctor {
        /// Prints the report as JSON.
        #[arg(long)]
        json: bool,
    },
}

impl Cli {
    /// Parses the command line; ends the process where it is wrong, or asks for help.
    pub(crate) fn of_arguments() -> Self {
        let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
        let words: Vec<String> = words.collect();
        let command = command().color(colour::of_words(&words));
        let parsed = command
            .clone()
            .try_get_matches()
            .and_then(|matches| Self::from_arg_matches(&matches));
        let cli =
            parsed.unwrap_or_else(|error| suggestion::with_tip(error, &command, &words).exit());
        colour::choose(cli.color);
        cli
    }

    /// Returns whether another process of this program has started this one, and speaks for it.
    pub(crate) fn is_worker(&self) -> bool {
        matches!(
            &self.command,
            Command::Curate(CurateArguments {
                command: CurateCommand::Worker
            })
        )
    }
}

/// Returns the whole command line, with examples and lists of values.
pub(crate) fn command() -> ClapCommand {
    guide::command()
}

/// Returns the command line for completions, which propose names of methods, protocols and formats.
pub(crate) fn command_with_values() -> ClapCommand {
    guide::command_with_values()
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
    fn curating_needs_no_further_word() {
        let parse = |words: &str| {
            Cli::try_parse_from(words.split(' ')).map(|cli| match cli.command {
                Command::Curate(arguments) => arguments.command,
                other => panic!("{other:?}"),
            })
        };
        for words in [
            "omnilife curate data --criteria none --out d",
            "omnilife curate build data --criteria none --out d",
        ] {
            let build = parse(words);
            assert!(
                matches!(&build, Ok(CurateCommand::Build(build)) if build.settings.criteria == "none"),
                "{words}: {build:?}"
            );
        }
        let verify = parse("omnilife curate verify d");
        assert!(
            matches!(verify, Ok(CurateCommand::Verify { .. })),
            "{verify:?}"
        );
        assert!(parse("omnilife curate data").is_err());
        assert!(parse("omnilife curate").is_err());
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
