//! `cameras`: views that were rendered with cameras by words.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{pose::Pose, store::Record};

/// `cameras.json`, beside the images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WordedViews {
    /// The words, such as `orbit 360` or `stationary 12`.
    pub cameras: String,
    /// Definition of the unseen shares.
    pub definition: String,
    /// Number of input views: posed input views of the split, or all posed frames without a split.
    pub input_views: u32,
    /// Reason why unseen shares are missing; `None` where they are measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unmeasured: Option<String>,
    /// The views in order.
    pub views: Vec<WordedView>,
}

impl Record for WordedViews {
    const SCHEMA: &'static str = "omnilife/cameras/1";
}

impl WordedViews {
    /// Returns the mean unseen share of the measured views; `None` without any.
    pub fn mean_unseen_share(&self) -> Option<f64> {
        let shares: Vec<f64> = (self.views.iter())
            .filter_map(|view| view.unseen_share)
            .collect();
        (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
    }
}

/// Rendered view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WordedView {
    /// Its images: one, or the six faces of a cube.
    pub files: Vec<String>,
    /// Presentation timestamp in seconds.
    pub time_seconds: f64,
    /// The camera.
    pub pose: Pose,
    /// Share in [0, 1] of the view that no input view saw.
    pub unseen_share: Option<f64>,
}
