//! Groups of views: what a feed-forward method is given and what it makes.

use glam::{DMat3, DVec3};
use omnilife_schemas::{Pose, RgbImage, camera::ErpCamera};

/// A view that is given.
#[derive(Debug, Clone, PartialEq)]
pub struct ContextView {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Where its camera is.
    pub camera_pose: CameraPose,
    /// Its image, at the scored size.
    pub image: RgbImage,
}

/// A camera's place, orientation and time.
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
    /// `None` when the pose is not usable.
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

/// Two given views and where the views between them are.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Size and model of all images.
    pub camera: ErpCamera,
    /// The given views, the earlier one first.
    pub context: [ContextView; 2],
    /// Where the predicted views are.
    pub targets: Vec<CameraPose>,
}

impl Group {
    /// Share of the second view at a target by time, in [0, 1]; 1/2 where both have the same time.
    pub fn share_of_second(&self, target: &CameraPose) -> f32 {
        let [first, second] = [0, 1].map(|i| self.context[i].camera_pose.time_seconds);
        let whole = second - first;
        if whole.abs() < f64::EPSILON {
            return 0.5;
        }
        ((target.time_seconds - first) / whole).clamp(0.0, 1.0) as f32
    }
}

/// What a feed-forward method makes of a group.
#[derive(Debug, Clone, PartialEq)]
pub struct Interpolated {
    /// One image per target.
    pub images: Vec<RgbImage>,
    /// Gaussians that were made and drawn.
    pub gaussians: u64,
    /// Time to understand the group, seconds; rendering is not in it.
    pub analysis_seconds: f64,
    /// Time to make the images, seconds.
    pub rendering_seconds: f64,
    /// What a reader of the images should know; empty where nothing is out of the ordinary.
    pub warnings: Vec<String>,
}
