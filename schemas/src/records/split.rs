//! `split`: the frames of one scene under one protocol.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::protocol::Protocol;
use crate::store::Record;

/// `split.json`. Frame numbers count the scene's frames from 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Split {
    /// Id of the scene.
    pub scene: String,
    /// The protocol, whole.
    pub protocol: Protocol,
    /// Its hash.
    pub protocol_hash: String,
    /// Frames a method may use.
    pub input_views: Vec<u32>,
    /// Frames a method must predict.
    pub novel_views: Vec<u32>,
    /// Frames left out because they have no pose.
    pub unposed: Vec<u32>,
    /// The groups of a protocol that has groups, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<ViewGroup>,
    /// Groups left out because they are not complete.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub incomplete: Vec<IncompleteGroup>,
}

/// Frames that a method sees together, and the frames that it predicts from them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ViewGroup {
    /// Given.
    pub context: Vec<u32>,
    /// Predicted.
    pub novel_views: Vec<u32>,
}

/// A group that is left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct IncompleteGroup {
    /// Its frames.
    pub frames: Vec<u32>,
    /// Reason why it is left out.
    pub reason: String,
}

impl Split {
    /// Makes the split of a scene into these frames under a protocol without groups.
    pub fn new(
        scene: &str,
        protocol: Protocol,
        input_views: Vec<u32>,
        novel_views: Vec<u32>,
    ) -> Self {
        Self {
            scene: scene.to_owned(),
            protocol_hash: protocol.hash(),
            protocol,
            input_views,
            novel_views,
            unposed: Vec::new(),
            groups: Vec::new(),
            incomplete: Vec::new(),
        }
    }
}

impl Record for Split {
    const SCHEMA: &'static str = "omnilife/split/2";
}
