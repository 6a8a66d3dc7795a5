//! `omnilife run`.

use std::path::PathBuf;

use clap::Args;
use omnilife_bench::PROTOCOLS;

use super::{
    curate::{CurationArguments, MemoryLimitArguments},
    poses::PoseArguments,
    reconstruct::MethodArguments,
};

#[derive(Debug, Args)]
pub(crate) struct RunArguments {
    /// Videos, folders of videos, or folders of still panoramas.
    #[arg(required = true)]
    pub(crate) videos: Vec<PathBuf>,
    /// Folder for everything that is made.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Where the videos came from, as `curate build` takes it; the dataset's record keeps it.
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
    pub(crate) method: MethodArguments,
    /// Optimizer steps; schedules scale with them. A first look has 1500 here and in `bench run`; the
    /// published protocol has the 30000 of `reconstruct train`.
    #[arg(long, default_value_t = 1500)]
    pub(crate) iterations: u64,
    /// Measures the distances of perspective videos by stereo first, for dense points (`curate dense`).
    /// object-graph does so by itself where poses come with few.
    #[arg(long)]
    pub(crate) dense: bool,
    /// The rules of splitting and scoring.
    #[arg(long, default_value = PROTOCOLS[0].id)]
    pub(crate) protocol: String,
}
