//! `omnilife leaderboard`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

#[derive(Debug, Subcommand)]
pub(crate) enum LeaderboardCommand {
    /// Makes tables and a static site from all results in a folder.
    ///
    /// OUT/table.md and table.csv hold all results; OUT/tables/ the layouts of the paper (Markdown, LaTeX,
    /// CSV), one folder per protocol; OUT/site/index.html opens without a network.
    Build(LeaderboardBuildArguments),
    /// Packs a method's results, its predictions and its card for handing in.
    Submit(SubmitResultsArguments),
    /// Checks what was handed in, scores a sample of it again, and takes it in.
    Add(AddArguments),
}

#[derive(Debug, Args)]
pub(crate) struct SubmitResultsArguments {
    /// Folder that is searched for results of the card's method.
    pub(crate) results: PathBuf,
    /// The card, TOML: method, title, authors, hardware; code, licence and notes where there are any.
    #[arg(long, value_name = "FILE")]
    pub(crate) card: PathBuf,
    /// Folder of the submission.
    #[arg(long)]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct AddArguments {
    /// Folder of the submission.
    pub(crate) submission: PathBuf,
    /// Folder of results that it is added to.
    #[arg(long)]
    pub(crate) results: PathBuf,
    /// Results whose predictions are scored again.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) audit: usize,
    /// Folder that is searched for the scenes, for --audit.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) scenes: Option<PathBuf>,
    /// Draws the same sample again [default: another one every time].
    #[arg(long, value_name = "SEED")]
    pub(crate) audit_seed: Option<u64>,
}

#[derive(Debug, Args)]
pub(crate) struct LeaderboardBuildArguments {
    /// Folder that is searched for result.json files, and for split.json files that explain their
    /// protocols.
    pub(crate) results: PathBuf,
    /// Folder of the leaderboard.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// A dataset.json whose videos the site shows.
    #[arg(long, value_name = "FILE")]
    pub(crate) dataset: Option<PathBuf>,
    /// A Markdown page whose table, between the lines `<!-- leaderboard: begin -->` and
    /// `<!-- leaderboard: end -->`, is replaced.
    #[arg(long, value_name = "FILE")]
    pub(crate) page: Option<PathBuf>,
    /// Rendered views per scene and method that the site shows, at most.
    #[arg(long, default_value_t = 4, value_name = "N")]
    pub(crate) views: usize,
    /// Make the tables alone.
    #[arg(long)]
    pub(crate) no_site: bool,
    /// Write nothing; fail where the tables, or that of --page, are not what the results give.
    #[arg(long)]
    pub(crate) check: bool,
}
