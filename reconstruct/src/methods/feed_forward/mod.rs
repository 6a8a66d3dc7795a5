//! Methods that learn nothing from a scene: from two views of a group, those between them.
//!
//! One file each, one line in [`METHODS`](super::METHODS). They follow any split: a protocol with groups says
//! which views belong together; under others every novel view is predicted from the input views
//! before and after it.

pub mod cross_fade;
pub mod infinity;
pub mod nearest;
pub mod sweep;

use glam::{DMat3, DVec3};
use omnilife_schemas::{Pose, RgbImage, camera::ErpCamera, records::Split};

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

/// Numbers of frames: two given ones and those to predict from them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupFrames {
    /// Given, the earlier one first.
    pub context: [u32; 2],
    /// To predict.
    pub novel_views: Vec<u32>,
}

/// The groups of a split: its own, or, where its protocol has none, the novel views between two
/// input views that follow each other. Novel views before the first input view or after the last
/// are predicted from the two input views nearest to them. `None` with fewer than two input views.
pub fn groups(split: &Split) -> Option<Vec<GroupFrames>> {
    if !split.groups.is_empty() {
        return split
            .groups
            .iter()
            .map(|group| {
                Some(GroupFrames {
                    context: [*group.context.first()?, *group.context.last()?],
                    novel_views: group.novel_views.clone(),
                })
            })
            .collect();
    }
    let inputs = &split.input_views;
    let last_pair = inputs.len().checked_sub(2)?;
    let mut groups: Vec<GroupFrames> = Vec::new();
    for &frame in &split.novel_views {
        let before = inputs.partition_point(|&input| input < frame);
        let pair = before.saturating_sub(1).min(last_pair);
        let context = [inputs[pair], inputs[pair + 1]];
        match groups.last_mut() {
            Some(group) if group.context == context => group.novel_views.push(frame),
            _ => groups.push(GroupFrames {
                context,
                novel_views: vec![frame],
            }),
        }
    }
    Some(groups)
}
