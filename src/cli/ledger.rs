//! `omnilife curate ledger`.

use std::path::PathBuf;

use clap::Subcommand;
use omnilife_curate::ledger::{self, Role};

use super::places;

#[derive(Debug, Subcommand)]
pub(crate) enum LedgerCommand {
    /// Appends what files say: boundaries in the formats of several tools, or an audit's decisions.
    Merge {
        /// Folder of a curated video: DATASET/videos/NAME.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
        /// CSV, JSON, PySceneDetect CSV, TransNetV2 scenes, EDL, Label Studio JSON, decisions.json.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// Who found the boundaries in the files; decisions name their author themselves.
        #[arg(long)]
        author: Option<String>,
        /// As what the author speaks.
        #[arg(long, default_value = "annotator", value_parser = parse_role)]
        role: Role,
        /// When, RFC 3339.
        #[arg(long)]
        time: Option<String>,
        /// Why.
        #[arg(long)]
        reason: Option<String>,
    },
    /// Prints all boundaries with their authors and what became of them, as JSON.
    Show {
        /// Folder of a curated video.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
    },
    /// Prints how far the authors agree: precision, recall, F1 and Cohen's kappa, as JSON.
    Agreement {
        /// Folder of a curated video.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
        /// Boundaries closer than this count as the same, in seconds.
        #[arg(long, default_value_t = 0.1, value_name = "SECONDS", value_parser = parse_tolerance)]
        tolerance: f64,
    },
    /// Prints the boundaries that hold in the format of another tool.
    Export {
        /// Folder of a curated video.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
        /// Format to print.
        #[arg(long, value_parser = parse_format)]
        format: String,
    },
}

fn parse_tolerance(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|seconds: &f64| seconds.is_finite() && *seconds > 0.0)
        .ok_or_else(|| "a tolerance is a positive number of seconds".to_owned())
}

fn parse_format(text: &str) -> Result<String, String> {
    ledger::formats::format(text).map(|format| format.id.to_owned())
}

/// Roles of authors by their names on the command line.
pub(super) const ROLES: [(&str, Role); 3] = [
    ("detector", Role::Detector),
    ("annotator", Role::Annotator),
    ("expert", Role::Expert),
];

fn parse_role(text: &str) -> Result<Role, String> {
    let role = ROLES.iter().find(|(name, _)| *name == text);
    role.map(|(_, role)| *role)
        .ok_or_else(|| "an author is a detector, an annotator or an expert".to_owned())
}
