//! `analysis`: findings of one pass over a video, before anything is cut.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::overlays::OverlayReport;
use super::sequence::{DetectedProjection, Probe, SourceVideo, TimeRange};
use super::sphere_layout::SphereLayout;
use crate::store::Record;

/// `analysis.json`: probe and detected projection of one video. The per-frame signals lie beside it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VideoAnalysis {
    /// The video.
    pub source: SourceVideo,
    /// From the first frame to the end of the last.
    pub range: TimeRange,
    /// Statements of the container, completed by measurements of the decoded frames.
    pub probe: Probe,
    /// Projection by pixels and metadata, before any override.
    #[serde(alias = "verdict")]
    pub projection: DetectedProjection,
    /// Layout of the sphere that frames are converted from: the requested one, else the one of the evidence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layout: Option<SphereLayout>,
    /// Overlays painted over the image or always in it; `None` where the image is not a single
    /// sphere.
    pub overlays: Option<OverlayReport>,
    /// Frames and packets that the decoder found damaged and patched up or left out.
    pub damaged_frames: u64,
    /// Frames that are marked as interlaced, used as stored: rows of two moments alternate in them.
    #[serde(default)]
    pub interlaced_frames: u64,
    /// Frames that repeat the picture of the one before, as in 15 pictures a second stored at 30.
    #[serde(default)]
    pub repeated_frames: u64,
    /// Frames of the longest run of them, all of one picture: a picture that stands still.
    #[serde(default)]
    pub longest_repetition_frames: u64,
    /// Frames without a time after that of the frame before, left out: as where files were joined end to end.
    #[serde(default)]
    pub frames_out_of_time: u64,
    /// Parquet table of the per-frame signals: `time_seconds` and the detector's columns.
    pub signals: String,
}

impl Record for VideoAnalysis {
    const SCHEMA: &'static str = "omnilife/analysis/2";
    const OLDER: &'static [&'static str] = &["omnilife/analysis/1"];
}
