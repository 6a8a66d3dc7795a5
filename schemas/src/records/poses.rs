//! `poses`: camera poses that somebody supplies for a video.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scene::Scale;
use crate::{pose::Pose, store::Record};

/// `poses.json`: camera poses by presentation time, with the points and masks that belong to them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Poses {
    /// Whether world units are metres.
    pub scale: Scale,
    /// Frames in order of time.
    pub frames: Vec<PosedFrame>,
    /// PLY file of world points relative to this file.
    pub points: Option<String>,
}

impl Record for Poses {
    const SCHEMA: &'static str = "omnilife/poses/1";
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
