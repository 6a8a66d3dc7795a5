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
}

impl Record for Split {
    const SCHEMA: &'static str = "omnilife/split/1";
}
