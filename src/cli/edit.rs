//! `omnilife reconstruct edit`.

use std::path::PathBuf;

use clap::Args;

use super::{numbers, places};

#[derive(Debug, Args)]
pub(crate) struct EditArguments {
    /// Folder of the run: vehicles of `object-graph`, nodes of `nag`.
    pub(crate) run: PathBuf,
    /// The script, TOML.
    #[arg(long, value_name = "EDIT.toml")]
    pub(crate) script: PathBuf,
    /// Folder of the edited run, or of the image of --preview.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Renders the edited run along the poses of a poses.json or scene.json, into views/ of its folder.
    #[arg(long, value_parser = places::poses())]
    pub(crate) poses: Option<PathBuf>,
    /// Renders this frame of the poses alone, from 0 on, at half its size, and keeps no edited run.
    #[arg(
        long,
        value_name = "FRAME",
        requires = "poses",
        conflicts_with = "video",
        value_parser = numbers::whole::<usize>
    )]
    pub(crate) preview: Option<usize>,
    /// Makes a video of the views too; players show views of the whole sphere as 360-degree video.
    #[arg(long, value_name = "FILE.mp4", requires = "poses")]
    pub(crate) video: Option<PathBuf>,
    /// The layer that is rendered, as in `reconstruct render`; images of object:ID have straight alpha [default: all].
    #[arg(long, requires = "poses")]
    pub(crate) layer: Option<String>,
}
