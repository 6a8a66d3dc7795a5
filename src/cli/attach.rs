//! `omnilife curate attach`.

use std::{path::PathBuf, time::Duration};

use clap::Args;
use omnilife_curate::{AttachRequest, FrameCommand, FramePrograms, GivenTruth};

use super::{
    numbers, places,
    poses::{IgnoreMaskArgument, MovingMasksArgument, PosesConventionArgument, TruthArguments},
};

/// `curate attach`.
#[derive(Debug, Args)]
pub(crate) struct AttachArguments {
    /// The scene.json, or its folder.
    #[arg(value_parser = places::scene_folder())]
    pub(crate) scene: PathBuf,
    /// Poses for a scene without them: a poses.json, a folder with a COLMAP model, or a .npy. A .npy has a matrix for
    /// every frame (N x 4 x 4 or N x 3 x 4).
    #[arg(long, group = "pose_files", help_heading = "Camera poses")]
    poses: Option<PathBuf>,
    /// Direction of the matrices of a .npy file, with camera axes x right, y down, z forward.
    #[arg(
        long,
        value_enum,
        value_name = "CONVENTION",
        requires = "pose_files",
        help_heading = "Camera poses"
    )]
    poses_convention: Option<PosesConventionArgument>,
    #[command(flatten)]
    masks: MovingMasksArgument,
    #[command(flatten)]
    ignored: IgnoreMaskArgument,
    #[command(flatten)]
    truth: TruthArguments,
    /// Takes dynamic masks from a program, which masks the frames in {frames} and leaves an image for each,
    /// named like it, in {out}, where it finds those of a run of the same command that failed. Words are separated by
    /// blanks; no shell takes them apart.
    #[arg(
        long,
        value_name = "COMMAND",
        conflicts_with = "masks",
        help_heading = "Programs"
    )]
    masks_command: Option<FrameCommand>,
    /// Takes depth priors from a program, which leaves a 16-bit grey PNG or a .npy for each frame.
    #[arg(
        long,
        value_name = "COMMAND",
        requires = "depth_prior_unit",
        conflicts_with = "depth_prior_source",
        group = "prior_files",
        help_heading = "Programs"
    )]
    depth_prior_command: Option<FrameCommand>,
    /// Takes the poses from a program, which leaves a poses.json or an `all_poses.npy`; {times} is a CSV with the times
    /// of the frames.
    #[arg(
        long,
        value_name = "COMMAND",
        group = "pose_files",
        help_heading = "Programs"
    )]
    poses_command: Option<FrameCommand>,
    /// Stops each program, and all that it started, after this many seconds.
    #[arg(
        long,
        default_value_t = 3600,
        value_name = "SECONDS",
        help_heading = "Programs",
        value_parser = numbers::count::<u64>
    )]
    command_timeout: u64,
}

impl AttachArguments {
    /// Returns the attachments that the options request.
    ///
    /// # Errors
    /// When a class is given twice.
    pub(crate) fn request(&self) -> anyhow::Result<AttachRequest> {
        let given = self.truth.given(GivenTruth {
            masks: self.masks.masks.clone(),
            ignored: self.ignored.ignore_mask.clone(),
            pose_convention: self.poses_convention.map(Into::into),
            ..GivenTruth::default()
        })?;
        let prior = self.depth_prior_command.clone();
        Ok(AttachRequest {
            poses: self.poses.clone(),
            given,
            programs: FramePrograms {
                masks: self.masks_command.clone(),
                prior: prior.and_then(|command| self.truth.prior_program(command)),
                poses: self.poses_command.clone(),
                time_limit: Some(Duration::from_secs(self.command_timeout)),
            },
        })
    }
}
