//! Sampled frames of a sequence: files, times, and the rule by which they were chosen.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::{capture::Capture, sphere_layout::SphereLayout};

/// Rule by which frames are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// At most this many frames, spread evenly in time.
    MaxFrames(u32),
    /// This many frames per second.
    FramesPerSecond(f64),
}

impl Sampling {
    /// Returns a line on a rate above that of the video, of which every frame is taken then; `None` for others.
    pub fn excess(self, frames_per_second: f64) -> Option<String> {
        let Self::FramesPerSecond(rate) = self else {
            return None;
        };
        // A rounded rate, such as 30 for 29.97, asks for every frame too.
        (rate > 1.01 * frames_per_second).then(|| {
            format!(
                "{rate} frames a second are more than the video has: its {frames_per_second:.3} are taken"
            )
        })
    }
}

/// Reads the side of an image in pixels, up to the limit for reading images.
fn side_pixels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    const MOST: u32 = 16_384;
    let pixels = u32::deserialize(deserializer)?;
    if (1..=MOST).contains(&pixels) {
        return Ok(pixels);
    }
    let reason = format!("the side of an image must be 1 to {MOST} pixels, got {pixels}");
    Err(serde::de::Error::custom(reason))
}

/// Sampled frames as images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameSet {
    /// Width in pixels; of ERP frames twice the height.
    #[serde(deserialize_with = "side_pixels")]
    pub width: u32,
    /// Height in pixels.
    #[serde(deserialize_with = "side_pixels")]
    pub height: u32,
    /// Rule by which frames were chosen.
    pub sampling: Sampling,
    /// Resampling from the decoded size; `none` if they keep it.
    pub resampling: String,
    /// Layout of the sphere in the video, if frames were converted from it to equirectangular.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub converted_from: Option<SphereLayout>,
    /// The frames in order of time.
    pub entries: Vec<FrameEntry>,
    /// Reasons for the frames, where the sharpest one near every evenly spaced instant was taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharpest: Option<SharpFrames>,
}

/// The choice of the sharpest frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SharpFrames {
    /// The measure of sharpness, with its unit.
    pub measure: String,
    /// One reason for every frame, in their order.
    pub frames: Vec<SharpFrame>,
}

/// The reason for a frame: nothing near the evenly spaced instant is sharper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SharpFrame {
    /// Its sharpness.
    pub sharpness: f64,
    /// Timestamp of the frame that even spacing takes, seconds.
    pub even_seconds: f64,
    /// Sharpness of that frame.
    pub even_sharpness: f64,
    /// Number of frames that were compared.
    pub candidates: u32,
}

/// One sampled frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameEntry {
    /// Image file relative to the sequence's folder.
    pub file: String,
    /// Presentation timestamp in the source, seconds.
    pub time_seconds: f64,
    /// Facts that the file of a still states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture: Option<Capture>,
}
