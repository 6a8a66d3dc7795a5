//! `omnilife curate ledger`.

use std::path::PathBuf;

use clap::Subcommand;
use omnilife_curate::ledger::{self, Role};

use super::{numbers, places};

#[derive(Debug, Subcommand)]
pub(crate) enum LedgerCommand {
    /// Appends the entries of files: boundaries in the formats of several tools, or an audit's decisions.
    Merge {
        /// Folder of a curated video: DATASET/videos/NAME.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
        /// CSV, JSON, PySceneDetect CSV, TransNetV2 scenes, EDL, Label Studio JSON, decisions.json.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// Author of the boundaries in the files; decisions name their author themselves.
        #[arg(long)]
        author: Option<String>,
        /// Role of the author: the decisions of an expert count above all proposals.
        #[arg(long, default_value = "annotator", value_parser = parse_role)]
        role: Role,
        /// Time of the decisions, RFC 3339.
        #[arg(long)]
        time: Option<String>,
        /// Reason of the decisions, kept in the ledger.
        #[arg(long)]
        reason: Option<String>,
    },
    /// Prints all boundaries with their authors and their state, as JSON.
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
        #[arg(long, default_value_t = 0.1, value_name = "SECONDS", value_parser = numbers::positive)]
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
        .ok_or_else(|| "must be detector, annotator or expert".to_owned())
}
