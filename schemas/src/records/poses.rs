//! `poses`: camera poses that a user supplies for a video.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scene::Scale;
use crate::{camera::Camera, pose::Pose, store::Record};

/// `poses.json`: camera poses by presentation time, with the points and masks that belong to them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Poses {
    /// Unit of the world: metres or arbitrary.
    pub scale: Scale,
    /// The camera of all frames: needed where it is a pinhole; images of another size scale it. None is
    /// ERP of the frames' size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Frames in order of time.
    pub frames: Vec<PosedFrame>,
    /// PLY file of world points relative to this file.
    pub points: Option<String>,
}

impl Poses {
    /// Returns the shortest time from a frame to the next one, seconds: frames without a pose, and those that a split
    /// leaves out, make single steps longer. `None` where no time rises.
    pub fn seconds_per_frame(&self) -> Option<f64> {
        let steps = self.frames.windows(2);
        let steps = steps.map(|pair| pair[1].time_seconds - pair[0].time_seconds);
        steps.filter(|step| *step > 0.0).min_by(f64::total_cmp)
    }

    /// Makes a record of poses without points.
    pub fn new(scale: Scale, camera: Option<Camera>, frames: Vec<PosedFrame>) -> Self {
        Self {
            scale,
            camera,
            frames,
            points: None,
        }
    }
}

impl Record for Poses {
    const SCHEMA: &'static str = "omnilife/poses/2";
    /// The older version has no camera.
    const OLDER: &'static [&'static str] = &["omnilife/poses/1"];
}

/// A pose at a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PosedFrame {
    /// Presentation timestamp in the video, seconds.
    pub time_seconds: f64,
    /// The camera.
    pub pose: Pose,
    /// Mask image of dynamic objects (white) relative to the poses file.
    pub mask: Option<String>,
}

impl PosedFrame {
    /// Makes a pose without a mask.
    pub fn new(time_seconds: f64, pose: Pose) -> Self {
        Self {
            time_seconds,
            pose,
            mask: None,
        }
    }
}
