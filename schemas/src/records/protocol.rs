//! `protocol`: what exactly is scored, so that scores can be compared.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    camera::ErpCamera,
    store::{self, Record},
};

/// The rules of a benchmark. Scores of protocols with different hashes are never ranked together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Protocol {
    /// Id such as `per-scene`.
    pub id: String,
    /// Version, raised on every change of meaning.
    pub version: u32,
    /// Which frames are given and which are predicted.
    pub split: SplitRule,
    /// Width of the scored images in pixels; `None` scores at the scene's own size.
    pub width: Option<u32>,
    /// How ground truth is brought to that size.
    pub resampling: Resampling,
    /// Ids of the metrics, with their variants.
    pub metrics: Vec<String>,
    /// What masks do to a score: `none` (whole images) in this version.
    pub mask_rule: String,
}

impl Record for Protocol {
    const SCHEMA: &'static str = "omnilife/protocol/1";
}

impl Protocol {
    /// Width and height of the scored images of a scene, in pixels: the scene's own, or the
    /// protocol's width with the height in proportion (rounded to nearest).
    ///
    /// # Errors
    /// When nothing could be scored at that size; says why.
    pub fn scored_size(&self, camera: &ErpCamera) -> Result<[u32; 2], String> {
        let [width, height] = [camera.width, camera.height];
        match self.width {
            _ if width == 0 || height == 0 => {
                Err(format!("its images are {width}x{height} pixels"))
            }
            None => Ok([width, height]),
            Some(0) => Err("scored images would have no pixels".to_owned()),
            Some(scored) if scored > width => Err(format!(
                "it scores images {scored} pixels wide, the scene has {width}, and ground truth is \
                 never enlarged"
            )),
            Some(scored) => {
                let ratio = f64::from(height) / f64::from(width);
                let scored_height = (f64::from(scored) * ratio).round().max(1.0) as u32;
                Ok([scored, scored_height])
            }
        }
    }

    /// SHA-256 of the protocol's JSON; the first 12 digits are printed beside scores.
    pub fn hash(&self) -> String {
        // A protocol is numbers and strings: its JSON cannot fail. An error would still give a
        // hash that equals no other protocol's.
        let text = serde_json::to_string(self).unwrap_or_else(|error| error.to_string());
        store::sha256_bytes(text.as_bytes())
    }
}

/// Which frames are given (input views) and which are predicted (novel views).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "rule")]
pub enum SplitRule {
    /// Of every `period` posed frames, the one at `offset` is a novel view.
    EveryNth {
        /// Length of the cycle, at least 2.
        period: u32,
        /// Position of the novel view in the cycle, below `period`.
        offset: u32,
    },
}

/// Resampling kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// Area averaging.
    Area,
}
