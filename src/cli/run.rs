//! `omnilife run`.

use std::{convert::Infallible, path::PathBuf, str::FromStr};

use clap::Args;
use omnilife_bench::PROTOCOLS;
use omnilife_curate::{FrameCommand, masks};
use omnilife_schemas::names;

use super::{
    curate::{CurationArguments, MemoryLimitArguments},
    numbers,
    poses::PoseArguments,
    reconstruct::MethodArguments,
    tracks::TrackArguments,
};

#[derive(Debug, Args)]
pub(crate) struct RunArguments {
    /// Videos, folders of videos, or folders of still panoramas.
    #[arg(required = true)]
    pub(crate) videos: Vec<PathBuf>,
    /// Folder for the dataset, runs, scores and tables.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Records the origin of each video: a list as `curate build` takes it, kept in the dataset's record.
    #[arg(long, value_name = "LIST")]
    pub(crate) sources: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) curation: CurationArguments,
    #[command(flatten)]
    pub(crate) limit: MemoryLimitArguments,
    /// Criteria that are evaluated and reported; nothing is rejected by them.
    #[arg(long, default_value = omnilife_curate::criteria::PROFILES[0].id)]
    pub(crate) criteria: String,
    #[command(flatten)]
    pub(crate) poses: PoseArguments,
    #[command(flatten)]
    pub(crate) masks: MaskStepArguments,
    #[command(flatten)]
    pub(crate) tracking: TrackArguments,
    #[command(flatten)]
    pub(crate) method: MethodArguments,
    /// Optimizer steps; schedules scale with them. A first look has 1500 here and in `bench run`; the
    /// published protocol has the 30000 of `reconstruct train`.
    #[arg(long, default_value_t = 1500, value_parser = numbers::count::<u64>)]
    pub(crate) iterations: u64,
    /// Measures the distances of perspective videos by stereo first, for dense points (`curate dense`).
    /// object-graph does so by itself where poses come with few.
    #[arg(long)]
    pub(crate) dense: bool,
    /// Protocol: the rules by which frames are split and scored.
    #[arg(long, default_value = PROTOCOLS[0].id)]
    pub(crate) protocol: String,
}

/// Dynamic masks.
#[derive(Debug, Args)]
#[command(next_help_heading = "Dynamic masks")]
pub(crate) struct MaskStepArguments {
    /// auto makes masks where the method trains on them and a detector reaches its bar on labelled footage, and none
    /// leaves them out. A folder has one for each frame, white where something moves. Structure from motion leaves it
    /// out, and the scene keeps it.
    #[arg(
        long,
        value_name = "auto|none|DIR",
        default_value = "auto",
        value_parser = MaskStepArgument::from_str
    )]
    pub(crate) masks: MaskStepArgument,
    /// Makes dynamic masks by this method of `curate masks`, even one below the bar.
    #[arg(
        long,
        value_name = "METHOD",
        conflicts_with_all = ["masks", "masks_command"],
        value_parser = parse_mask_method
    )]
    pub(crate) masks_method: Option<String>,
    /// Takes dynamic masks from a program, which masks the frames in {frames} and leaves an image for each, named like it, in
    /// {out}. Words are separated by blanks; no shell takes them apart.
    #[arg(long, value_name = "COMMAND", conflicts_with = "masks")]
    pub(crate) masks_command: Option<FrameCommand>,
    /// Masks the operator, a mount or a helmet in every sequence, as `curate operator` does, and ignores that region.
    #[arg(long, conflicts_with = "ignore_mask")]
    pub(crate) operator: bool,
    /// Stops the program, and all that it started, after this many seconds for each sequence.
    #[arg(
        long,
        default_value_t = 3600,
        value_name = "SECONDS",
        value_parser = numbers::count::<u64>
    )]
    pub(crate) command_timeout: u64,
}

/// Origin of the dynamic masks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum MaskStepArgument {
    Auto,
    None,
    Folder(PathBuf),
}

impl FromStr for MaskStepArgument {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "auto" => Self::Auto,
            "none" => Self::None,
            folder => Self::Folder(PathBuf::from(folder)),
        })
    }
}

fn parse_mask_method(text: &str) -> Result<String, String> {
    names::find("mask method", text, masks::METHODS, |method| method.id)
        .map(|method| method.id.to_owned())
        .map_err(|unknown| unknown.to_string())
}
