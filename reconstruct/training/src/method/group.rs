//! Groups of views: inputs and outputs of feed-forward methods.

use glam::{DMat3, DVec3};
use omnilife_schemas::{Pose, RgbImage, camera::ErpCamera};

/// An input view.
#[derive(Debug, Clone, PartialEq)]
pub struct ContextView {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Pose of its camera.
    pub camera_pose: CameraPose,
    /// Its image, at the scored size.
    pub image: RgbImage,
}

/// A camera's position, orientation and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    /// Camera-to-world rotation.
    pub to_world: DMat3,
    /// Centre in world units.
    pub centre: DVec3,
    /// Presentation timestamp in seconds.
    pub time_seconds: f64,
}

impl CameraPose {
    /// Returns `None` if the pose is not usable.
    pub fn new(pose: &Pose, time_seconds: f64) -> Option<Self> {
        let centre = pose.centre();
        centre.is_finite().then_some(())?;
        Some(Self {
            to_world: DMat3::from_quat(pose.rotation()?),
            centre,
            time_seconds,
        })
    }
}

/// Two input views and the poses of the views between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Size and model of all images.
    pub camera: ErpCamera,
    /// The input views, the earlier one first.
    pub context: [ContextView; 2],
    /// Poses of the novel views.
    pub targets: Vec<CameraPose>,
}

impl Group {
    /// Returns the share of the second view at a target by time, in [0, 1]; 1/2 where both have the same time.
    pub fn share_of_second(&self, target: &CameraPose) -> f32 {
        let [first, second] = [0, 1].map(|i| self.context[i].camera_pose.time_seconds);
        let whole = second - first;
        if whole.abs() < f64::EPSILON {
            return 0.5;
        }
        ((target.time_seconds - first) / whole).clamp(0.0, 1.0) as f32
    }
}

/// Output of a feed-forward method for a group.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupOutput {
    /// One image per target.
    pub images: Vec<RgbImage>,
    /// Number of rendered Gaussians.
    pub gaussians: u64,
    /// Time of the analysis of the group, seconds, without rendering.
    pub analysis_seconds: f64,
    /// Time of rendering the images, seconds.
    pub rendering_seconds: f64,
    /// Warnings for readers of the images; mostly empty.
    pub warnings: Vec<String>,
}
