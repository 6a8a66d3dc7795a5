//! `pose-scores`: errors of estimated camera poses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scene::Scale;
use crate::store::Record;

/// Scores of a trajectory, as `bench poses --out` writes them. Lengths are in units of the reference's world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseScores {
    /// Id of the scene.
    pub scene: String,
    /// Name of the file or folder of the estimated poses.
    pub trajectory: String,
    /// Name of the file or folder of the true poses; absent where the scene's own poses are the reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// Unit of the reference's world.
    pub unit: Scale,
    /// Motions that bring the trajectory to the reference.
    pub alignment: PoseAlignment,
    /// Frames with a reference pose.
    pub frames: u32,
    /// Frames of these with an estimated pose.
    pub registered_frames: u32,
    /// Length of the reference's path over the registered frames.
    pub path_length: f64,
    /// Length of a unit of the trajectory after the alignment.
    pub scale: f64,
    /// Absolute trajectory error: root of the mean squared distance of the centres after the alignment. Absent where
    /// the reference stays in one place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ate_rmse: Option<f64>,
    /// The same for the first, second and third part of the frames, by number; absent where none is registered.
    pub ate_rmse_of_thirds: [Option<f64>; 3],
    /// Errors of the motions between neighbouring registered frames; absent without neighbours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative: Option<RelativePoseError>,
    /// Areas under the curves of pairwise errors, by threshold.
    pub auc: Vec<PoseAuc>,
    /// Errors of the motions along parts of the path, from short to long ones.
    pub drift: Vec<PoseDrift>,
    /// Lines on what the scores do not say.
    pub notes: Vec<String>,
}

impl Record for PoseScores {
    const SCHEMA: &'static str = "omnilife/pose-scores/1";
}

/// Motions that bring a trajectory to the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PoseAlignment {
    /// Rotation, translation and one scale.
    Similarity,
    /// Rotation and translation.
    Rigid,
}

/// Relative pose error from a frame to the next one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RelativePoseError {
    /// Pairs of neighbours that both have poses.
    pub pairs: u32,
    /// Root of the mean squared angle, degrees.
    pub rotation_rmse_degrees: f64,
    /// Root of the mean squared length, after the alignment.
    pub translation_rmse: f64,
}

/// Area under the curve of pairwise errors up to a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseAuc {
    /// The threshold.
    pub degrees: f64,
    /// Area over the threshold, 0 to 1.
    pub auc: f64,
}

/// Mean error of the motion along parts of the path of one length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseDrift {
    /// Length of the parts as a share of the path.
    pub path_share: f64,
    /// Their mean duration, seconds.
    pub seconds: f64,
    /// Number of parts.
    pub parts: u32,
    /// Error of the translation as a share of the length.
    pub translation_share: f64,
    /// Error of the rotation, degrees.
    pub rotation_degrees: f64,
}
