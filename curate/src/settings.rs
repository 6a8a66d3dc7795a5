//! User settings of curation.

use std::{fmt, path::Path, str::FromStr};

use omnilife_schemas::records::{Sampling, SphereLayout, VideoProjection};
use serde::{Deserialize, Serialize};

use crate::{
    boundaries::{self, DEFAULT_DETECTOR},
    criteria,
    error::CurateError,
    sharpness::View,
    slicing::SliceSettings,
};

/// Settings of curation; everything they affect is regenerated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurateSettings {
    /// Name of the admission criteria, see [`criteria::PROFILES`], or a `.toml` file of them.
    pub profile: String,
    /// True if a video that misses them is rejected; otherwise they are evaluated and recorded.
    pub enforce: bool,
    /// Sampling of frames.
    pub sampling: Sampling,
    /// Choice of frames around the instants of the sampling.
    pub select: FrameSelection,
    /// Width of sampled frames in pixels; at most 1024 if `None`.
    pub width: Option<u32>,
    /// Takes the video as `erp`, `erp-squeezed` or, for a pinhole, `rectilinear`, regardless of the evidence.
    pub accept: Option<VideoProjection>,
    /// Takes the video as a sphere in this layout, regardless of the evidence, and converts its frames to
    /// equirectangular ones.
    pub layout: Option<LayoutChoice>,
    /// Shorter shots are dropped, seconds.
    pub minimum_shot_seconds: f64,
    /// Id of the boundary detector, see [`boundaries::DETECTORS`].
    pub detector: String,
    /// Settings of slices; `None` for no slices.
    pub slices: Option<SliceSettings>,
}

/// Choice of frames around evenly spaced instants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum FrameSelection {
    /// The frames nearest to the instants.
    #[default]
    Even,
    /// The sharpest frames near the instants.
    Sharp,
}

/// The user's statement of a video's sphere layout.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum LayoutChoice {
    /// A known layout.
    Known(SphereLayout),
    /// The circles of two lenses, whose field of view and places are to be estimated.
    UnknownDualFisheye,
}

impl FromStr for LayoutChoice {
    type Err = String;

    /// Parses a layout; `dual-fisheye` alone leaves its lenses to be estimated.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "dual-fisheye" {
            return Ok(Self::UnknownDualFisheye);
        }
        text.parse().map(Self::Known)
    }
}

impl fmt::Display for LayoutChoice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Known(layout) => layout.fmt(formatter),
            Self::UnknownDualFisheye => formatter.write_str("dual-fisheye"),
        }
    }
}

impl Default for CurateSettings {
    fn default() -> Self {
        Self {
            profile: criteria::OMNILIFE360.id.to_owned(),
            enforce: true,
            sampling: Sampling::MaxFrames(120),
            select: FrameSelection::default(),
            width: None,
            accept: None,
            layout: None,
            minimum_shot_seconds: 1.0,
            detector: DEFAULT_DETECTOR.to_owned(),
            slices: None,
        }
    }
}

/// Returns true if frames of this projection are those of a pinhole camera.
fn is_pinhole(projection: VideoProjection) -> bool {
    projection == VideoProjection::Rectilinear
}

/// Returns true for a width that frames can have.
pub(crate) fn is_frame_width(width: u32) -> bool {
    width >= 16 && width.is_multiple_of(2)
}

/// Returns the reason why frames cannot have a width.
pub(crate) fn width_fault(width: u32) -> String {
    format!("a frame width of {width} pixels is not an even number of at least 16")
}

impl CurateSettings {
    /// Returns the kind of images that frames are.
    pub(crate) fn view(&self) -> View {
        match self.accept {
            Some(projection) if is_pinhole(projection) => View::Flat,
            _ => View::Sphere,
        }
    }

    /// Refuses invalid settings and unknown names; `video` is named in the error.
    ///
    /// # Errors
    /// [`CurateError::Input`] with the first fault.
    pub fn check(&self, video: &Path) -> Result<(), CurateError> {
        boundaries::detector(&self.detector, video)?;
        criteria::criteria(&self.profile, video)?;
        if let Some(width) = self.width.filter(|&width| !is_frame_width(width)) {
            return Err(CurateError::input(video, width_fault(width)));
        }
        let sampling_is_positive = match self.sampling {
            Sampling::MaxFrames(most) => most > 0,
            Sampling::FramesPerSecond(rate) => rate.is_finite() && rate > 0.0,
        };
        let reason = if !sampling_is_positive {
            "the number or rate of sampled frames must be positive"
        } else if !self.minimum_shot_seconds.is_finite() || self.minimum_shot_seconds < 0.0 {
            "the minimum shot length must be at least 0 seconds"
        } else if self
            .accept
            .is_some_and(|projection| !projection.is_monoscopic_erp() && !is_pinhole(projection))
        {
            "only erp, erp-squeezed and pinhole can be accepted, nothing else can be reconstructed"
        } else if self.accept.is_some() && self.layout.is_some() {
            "a video is either taken as a projection or converted from another one"
        } else if self.accept.is_some_and(is_pinhole) && self.slices.is_some() {
            "slices are marked as 360-degree video, and the video is taken as that of a pinhole"
        } else {
            return Ok(());
        };
        Err(CurateError::input(video, reason))
    }
}
