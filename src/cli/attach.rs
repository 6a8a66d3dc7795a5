//! `omnilife curate attach`.

use std::path::PathBuf;

use clap::Args;
use omnilife_curate::GivenTruth;

use super::{
    places,
    poses::{FrameMaskArguments, PosesConventionArgument, TruthArguments},
};

/// `curate attach`.
#[derive(Debug, Args)]
pub(crate) struct AttachArguments {
    /// The scene.json, or its folder.
    #[arg(value_parser = places::scene_folder())]
    pub(crate) scene: PathBuf,
    /// Poses for a scene that has none: a poses.json, a folder with a COLMAP model, or a .npy with a matrix for every
    /// frame (N x 4 x 4 or N x 3 x 4).
    #[arg(long, help_heading = "Camera poses")]
    pub(crate) poses: Option<PathBuf>,
    /// What the matrices of a .npy map, with camera axes x right, y down, z forward.
    #[arg(
        long,
        value_enum,
        value_name = "CONVENTION",
        requires = "poses",
        help_heading = "Camera poses"
    )]
    poses_convention: Option<PosesConventionArgument>,
    #[command(flatten)]
    masks: FrameMaskArguments,
    #[command(flatten)]
    truth: TruthArguments,
}

impl AttachArguments {
    /// What is attached beside the poses.
    ///
    /// # Errors
    /// When a class is given twice.
    pub(crate) fn given(&self) -> anyhow::Result<GivenTruth> {
        self.truth.given(GivenTruth {
            masks: self.masks.masks.clone(),
            ignored: self.masks.ignore_mask.clone(),
            pose_convention: self.poses_convention.map(Into::into),
            ..GivenTruth::default()
        })
    }
}
