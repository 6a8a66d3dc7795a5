//! `protocol`: definition of the scored views and metrics, so that scores can be compared.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    camera::Camera,
    padded_frame::PaddedFrame,
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
    /// Which of them are scored.
    pub scored: ScoredViews,
    /// Images that are wider than this many pixels are scored at this width, their height in
    /// proportion; nothing is enlarged. `None` scores at the scene's own size.
    pub largest_width: Option<u32>,
    /// Resampling of images to that size.
    pub resampling: Resampling,
    /// Padding around images, for methods that take frames of one size.
    pub padding: Padding,
    /// Encoding of the numbers of a scored pixel.
    pub colour: Colour,
    /// Ids of the metrics, with their variants.
    pub metrics: Vec<String>,
    /// Effect of masks on a score: `none` (whole images) in this version.
    pub mask_rule: String,
}

impl Record for Protocol {
    const SCHEMA: &'static str = "omnilife/protocol/2";
}

impl Protocol {
    /// Makes the first version of rules that score whole images at the scene's own size, by no metric yet.
    pub fn new(id: &str, split: SplitRule, scored: ScoredViews) -> Self {
        Self {
            id: id.to_owned(),
            version: 1,
            split,
            scored,
            largest_width: None,
            resampling: Resampling::Area,
            padding: Padding::None,
            colour: Colour::Srgb8,
            metrics: Vec::new(),
            mask_rule: "none".to_owned(),
        }
    }

    /// Returns width and height of the scored images of a scene, in pixels: the scene's own, or where that is wider
    /// than [`Protocol::largest_width`], that width with the height in proportion (rounded to nearest). With padded
    /// frames it is the size of the image in them.
    ///
    /// # Errors
    /// When nothing could be scored at that size; states the reason.
    pub fn scored_size(&self, camera: &Camera) -> Result<[u32; 2], String> {
        match self.padded_frame(camera)? {
            Some(frame) => Ok(frame.image()),
            None => self.largest_size(camera),
        }
    }

    /// Returns the frame in which methods get the images of a scene; `None` without padding.
    ///
    /// # Errors
    /// Those of [`Protocol::scored_size`].
    pub fn padded_frame(&self, camera: &Camera) -> Result<Option<PaddedFrame>, String> {
        match self.padding {
            Padding::None => Ok(None),
            Padding::Frame { width, height } => {
                PaddedFrame::fit(self.largest_size(camera)?, [width, height]).map(Some)
            }
        }
    }

    fn largest_size(&self, camera: &Camera) -> Result<[u32; 2], String> {
        let [width, height] = [camera.width(), camera.height()];
        match self.largest_width {
            _ if width == 0 || height == 0 => {
                Err(format!("its images are {width}x{height} pixels"))
            }
            Some(0) => Err("scored images would have no pixels".to_owned()),
            None => Ok([width, height]),
            Some(largest) if largest >= width => Ok([width, height]),
            Some(scored) => {
                let ratio = f64::from(height) / f64::from(width);
                let scored_height = (f64::from(scored) * ratio).round().max(1.0) as u32;
                Ok([scored, scored_height])
            }
        }
    }

    /// Returns the SHA-256 of the protocol's JSON; the first 12 digits are printed beside scores.
    pub fn hash(&self) -> String {
        // A protocol is numbers and strings: its JSON cannot fail. An error would still give a
        // hash that equals no other protocol's.
        let text = serde_json::to_string(self).unwrap_or_else(|error| error.to_string());
        store::sha256_bytes(text.as_bytes())
    }
}

/// Which frames are given (input views) and which are predicted (novel views).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "rule")]
pub enum SplitRule {
    /// The posed frame at `offset` of every `period` is a novel view.
    EveryNth {
        /// Length of the cycle, at least 2.
        period: u32,
        /// Position of the novel view in the cycle, below `period`.
        offset: u32,
    },
    /// Groups of consecutive frames without overlap, from the first frame on. The first and the last
    /// frame of a group are its context and are given; those between them are its novel views. A
    /// group without all of its frames, or with one that has no pose, is left out.
    Groups {
        /// Frames of a group, at least 3.
        length: u32,
    },
    /// `count` posed frames, spread evenly from the first on, are input views, all others novel ones.
    EvenlyGiven {
        /// Frames that are given, at least 1.
        count: u32,
    },
    /// These posed frames are input views, all other posed ones novel views.
    Given {
        /// Frames of the scene, ascending, at least 1.
        frames: Vec<u32>,
    },
    /// Every posed frame is an input view; nothing is held out.
    AllGiven,
    /// The frames are those that the scene's `published_split` lists.
    Published,
}

/// Which views of a split are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScoredViews {
    /// Input views and novel views, apart.
    InputAndNovel,
    /// Novel views alone.
    Novel,
    /// Input views alone.
    Input,
}

impl ScoredViews {
    /// Returns whether input views are scored.
    pub fn has_input(self) -> bool {
        self != Self::Novel
    }

    /// Returns whether novel views are scored.
    pub fn has_novel(self) -> bool {
        self != Self::Input
    }
}

/// Padding around images, for methods that take frames of one size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Padding {
    /// Nothing: a scored image is all that the camera sees. Video that is stored squeezed was widened when
    /// its frames were taken, and video that shows less than the sphere makes no scene.
    None,
    /// Images are resized in proportion, never enlarged, and stand in the middle of frames of this size
    /// ([`PaddedFrame`]). A prediction may fill the frame; its padding is cut off before scoring.
    Frame {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
}

/// Encoding of the numbers of a scored pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Colour {
    /// Red, green and blue as decoded (sRGB, not linearized), of 8 bits, prediction and ground truth
    /// alike; resized before they are rounded.
    Srgb8,
}

/// Resampling kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// Area averaging.
    Area,
}
