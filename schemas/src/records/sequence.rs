//! `sequence`: one continuous, verified segment of a source video and its sampled frames.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    frame_set::{FrameEntry, FrameSet, Sampling},
    sphere_layout::SphereLayout,
};
use crate::store::Record;

/// `sequence.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sequence {
    /// `<video>/<seq-NNN>`, unique in its dataset.
    pub id: String,
    /// The video it was cut from.
    pub source: SourceVideo,
    /// Its segment of the source.
    pub range: TimeRange,
    /// Statements of the container and the decoder.
    pub probe: Probe,
    /// Detected projection of the video, with evidence.
    #[serde(alias = "verdict")]
    pub projection: DetectedProjection,
    /// Result of the dataset's admission criteria for the source.
    pub admission: Admission,
    /// The sampled frames.
    pub frames: FrameSet,
    /// Small frames in which motion is measured, where the sampled ones are too far apart in time: pairs of close
    /// frames, one after the other.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion_frames: Vec<FrameEntry>,
}

impl Sequence {
    /// Makes a sequence of panoramas of this size (width, height) that were not cut from a video.
    pub fn of_panoramas(id: &str, [width, height]: [u32; 2], entries: Vec<FrameEntry>) -> Self {
        Self {
            id: id.to_owned(),
            source: SourceVideo {
                file_name: id.to_owned(),
                sha256: String::new(),
                bytes: 0,
            },
            range: TimeRange::new(0.0, entries.last().map_or(0.0, |last| last.time_seconds)),
            probe: Probe::of_size([width, height]),
            projection: DetectedProjection {
                projection: VideoProjection::Erp,
                overridden: None,
                evidence: Vec::new(),
                disagreement: None,
            },
            admission: Admission {
                profile: "none".to_owned(),
                checks: Vec::new(),
                reported: Vec::new(),
                admitted: true,
                enforced: false,
            },
            frames: FrameSet {
                width,
                height,
                sampling: Sampling::MaxFrames(entries.len() as u32),
                resampling: "none".to_owned(),
                converted_from: None,
                entries,
                sharpest: None,
            },
            motion_frames: Vec::new(),
        }
    }

    /// Returns width and height in pixels of the source's images: of one upright panorama, however the video stores it.
    pub fn source_size(&self) -> (u32, u32) {
        self.probe.sphere_size(self.frames.converted_from)
    }

    /// Returns one line per fault of the frames: a file that stands twice, a time outside of the sequence or before
    /// that of the frame before.
    pub fn faults(&self) -> Vec<String> {
        let entries = &self.frames.entries;
        let mut faults = Vec::new();
        let mut files = BTreeSet::new();
        for FrameEntry {
            file, time_seconds, ..
        } in entries
        {
            if !files.insert(file) {
                faults.push(format!("{file} is listed twice"));
            }
            if !self.range.contains(*time_seconds) {
                faults.push(format!(
                    "the time of {file}, {time_seconds} s, is outside the sequence"
                ));
            }
        }
        let pairs = entries.iter().zip(entries.iter().skip(1));
        let disordered = pairs.filter(|(before, after)| after.time_seconds < before.time_seconds);
        faults.extend(disordered.map(|(before, after)| {
            format!("{} is earlier than {} before it", after.file, before.file)
        }));
        faults
    }

    /// Returns whether its frames are perspective images. The evidence alone never makes a sequence of such a video;
    /// a user has to state it.
    pub fn is_pinhole(&self) -> bool {
        self.projection.projection == VideoProjection::Rectilinear
    }
}

impl Record for Sequence {
    const SCHEMA: &'static str = "omnilife/sequence/2";
    const OLDER: &'static [&'static str] = &["omnilife/sequence/1"];
}

/// A source file by content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SourceVideo {
    /// File name without its folder.
    pub file_name: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Size in bytes.
    pub bytes: u64,
}

/// A half-open segment of time in seconds of the source's presentation timestamps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TimeRange {
    /// First instant inside.
    pub begin_seconds: f64,
    /// First instant outside.
    pub end_seconds: f64,
}

impl TimeRange {
    /// Makes a segment from its first instant inside to its first instant outside.
    pub const fn new(begin_seconds: f64, end_seconds: f64) -> Self {
        Self {
            begin_seconds,
            end_seconds,
        }
    }

    /// Returns the length in seconds.
    pub fn duration_seconds(&self) -> f64 {
        self.end_seconds - self.begin_seconds
    }

    /// Returns whether an instant lies inside.
    pub fn contains(&self, seconds: f64) -> bool {
        self.begin_seconds <= seconds && seconds < self.end_seconds
    }
}

/// Statements of the container and the decoder about a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Probe {
    /// Container format, FFmpeg's short name.
    pub container: String,
    /// Video codec, FFmpeg's short name.
    pub codec: String,
    /// Coded width in pixels.
    pub width: u32,
    /// Coded height in pixels.
    pub height: u32,
    /// FFmpeg's pixel format name.
    pub pixel_format: String,
    /// Bits per component.
    pub bit_depth: u32,
    /// Frames per second: the measured mean where frames were decoded, else the container's.
    pub frames_per_second: f64,
    /// Duration in seconds, from the container or, failing that, the last timestamp.
    pub duration_seconds: f64,
    /// Decoded frames, where the video was decoded to its end.
    pub decoded_frames: Option<u64>,
    /// `true` if the distance between frames varies by more than half a percent of the typical one.
    pub variable_frame_rate: Option<bool>,
    /// Largest distance between two frames, seconds, where the video was decoded to its end.
    pub longest_interval_seconds: Option<f64>,
    /// Display rotation in degrees.
    pub rotation_degrees: f64,
    /// Width of a pixel over its height.
    pub pixel_aspect_ratio: f64,
    /// Transfer characteristic, FFmpeg's name: bt709, smpte2084 (PQ), arib-std-b67 (HLG), unknown ...
    pub transfer: String,
    /// Primaries of colours, FFmpeg's name: bt709, bt2020, smpte432 (Display P3), unknown ...; empty in older records.
    #[serde(default)]
    pub primaries: String,
    /// Matrix between YUV and RGB that is taken because the file states none: BT.709 for images above 576 rows or 1,024
    /// columns, else BT.601. `null` for one that states it, or has RGB; in older records.
    #[serde(default)]
    pub assumed_matrix: Option<String>,
    /// Spherical metadata, where there is any.
    pub spherical: Option<SphericalMetadata>,
}

impl Probe {
    /// Makes the probe of 8-bit images of this size (width, height) that stand upright, with square pixels. Names are
    /// empty, rate and duration 0.
    pub fn of_size([width, height]: [u32; 2]) -> Self {
        Self {
            container: String::new(),
            codec: String::new(),
            width,
            height,
            pixel_format: String::new(),
            bit_depth: 8,
            frames_per_second: 0.0,
            duration_seconds: 0.0,
            decoded_frames: None,
            variable_frame_rate: None,
            longest_interval_seconds: None,
            rotation_degrees: 0.0,
            pixel_aspect_ratio: 1.0,
            transfer: "unknown".to_owned(),
            primaries: "unknown".to_owned(),
            assumed_matrix: None,
            spherical: None,
        }
    }

    /// Returns whether levels are coded for high dynamic range. They are used as coded, not tone-mapped.
    pub fn is_hdr(&self) -> bool {
        matches!(self.transfer.as_str(), "smpte2084" | "arib-std-b67")
    }

    /// Returns whether colours have primaries of a wider gamut than that of sRGB. They are used as coded.
    pub fn is_wide_gamut(&self) -> bool {
        matches!(self.primaries.as_str(), "bt2020" | "smpte431" | "smpte432")
    }

    /// Returns the quarter turns clockwise that bring the coded image upright, 0 to 3.
    pub fn clockwise_quarter_turns(&self) -> u32 {
        (self.rotation_degrees / 90.0).round().rem_euclid(4.0) as u32
    }

    /// Returns width and height in pixels of the upright image.
    pub fn upright_size(&self) -> (u32, u32) {
        if self.clockwise_quarter_turns() % 2 == 1 {
            (self.height, self.width)
        } else {
            (self.width, self.height)
        }
    }

    /// Returns width and height in pixels of the panorama of a layout; those of the upright image without one.
    pub fn sphere_size(&self, layout: Option<SphereLayout>) -> (u32, u32) {
        let stored = self.upright_size();
        layout.map_or(stored, |layout| {
            let width = layout.erp_width(stored);
            (width, width / 2)
        })
    }
}

/// A turn of a sphere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SphereTurn {
    /// About the axis up, -180 to 180.
    pub yaw_degrees: f64,
    /// About the axis to the right, -90 to 90.
    pub pitch_degrees: f64,
    /// About the axis ahead, -180 to 180.
    pub roll_degrees: f64,
}

/// Spherical video metadata of the container.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SphericalMetadata {
    /// Projection, FFmpeg's name: equirectangular, cubemap, ...
    pub projection: String,
    /// Stereo layout, FFmpeg's name, where it is stated.
    pub stereo: Option<String>,
    /// `true` if the right eye's image is stated to be the first: above, or on the left.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_right_eye_first: bool,
    /// `true` if the image is stated to cover only a part of the sphere.
    pub is_cropped: bool,
    /// `true` if that part is the half of the sphere ahead: half a turn across, from pole to pole (VR180).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_front_half: bool,
    /// Pose that players give the sphere, where it is not zero: yaw counter-clockwise, then pitch counter-clockwise,
    /// then roll clockwise (box `prhd` of version 2, elements `ProjectionPose` of Matroska). Frames are not turned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<SphereTurn>,
    /// First view of players, if it is not ahead: heading, pitch and roll (entries `InitialView` of version 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_view: Option<SphereTurn>,
    /// Why a turn that is stated is neither of the two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_fault: Option<String>,
    /// Source of the metadata: `v2` (boxes `st3d` and `sv3d`), `v1` (XML in a `uuid` box) or `container`.
    pub origin: String,
    /// Statement of version 1 if it differs from version 2, which wins.
    pub conflict: Option<String>,
}

/// Kind of image in a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VideoProjection {
    /// Equirectangular, 2:1.
    Erp,
    /// Equirectangular stored at another aspect ratio.
    ErpSqueezed,
    /// Two equirectangular images, left eye above right eye.
    ErpStereoTb,
    /// Two equirectangular images side by side.
    ErpStereoLr,
    /// The half of the sphere ahead, equirectangular, of one eye or two (VR180).
    HalfErp,
    /// Equi-angular or plain cube faces.
    Eac,
    /// One or two fisheye circles.
    Fisheye,
    /// An ordinary perspective video.
    Rectilinear,
    /// The evidence does not decide.
    Unsure,
}

impl VideoProjection {
    /// Returns whether frames can be used as ERP after resizing to 2:1.
    pub fn is_monoscopic_erp(self) -> bool {
        matches!(self, Self::Erp | Self::ErpSqueezed)
    }

    /// Returns the name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Erp => "erp",
            Self::ErpSqueezed => "erp-squeezed",
            Self::ErpStereoTb => "erp-stereo-tb",
            Self::ErpStereoLr => "erp-stereo-lr",
            Self::HalfErp => "half-erp",
            Self::Eac => "eac",
            Self::Fisheye => "fisheye",
            Self::Rectilinear => "rectilinear",
            Self::Unsure => "unsure",
        }
    }
}

/// The projection with what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DetectedProjection {
    /// The projection in force.
    #[serde(alias = "verdict")]
    pub projection: VideoProjection,
    /// Projection by the evidence of the whole video, if the user or most of the time of its shots override it.
    pub overridden: Option<VideoProjection>,
    /// Every test with its value.
    pub evidence: Vec<Evidence>,
    /// Set where the metadata and the pixels disagree.
    pub disagreement: Option<String>,
}

/// One test's value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Evidence {
    /// Name of the test.
    pub test: String,
    /// Its value.
    pub value: f64,
    /// The limit it is compared with.
    pub limit: f64,
    /// Reading of the evidence, in words.
    pub reading: String,
}

/// Result of a named profile of admission criteria for a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Admission {
    /// Name of the profile, `omnilife360` or `none`.
    pub profile: String,
    /// Outcomes of the checks that decide on the admission.
    pub checks: Vec<CheckOutcome>,
    /// Outcomes of checks that decide nothing, because their detector is below its bar on labelled footage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reported: Vec<CheckOutcome>,
    /// `true` if all of `checks` passed.
    pub admitted: bool,
    /// `true` if a failed one of `checks` rejects the video.
    pub enforced: bool,
}

/// One admission check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CheckOutcome {
    /// Id of the check.
    pub check: String,
    /// `true` if the check passed.
    pub passed: bool,
    /// Measured value.
    pub value: String,
    /// Required value.
    pub threshold: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_out_of_order_listed_twice_or_outside_are_faults() {
        let sequence = |frames: &[(&str, f64)]| {
            let entries = frames.iter().map(|&(file, time_seconds)| FrameEntry {
                file: file.to_owned(),
                time_seconds,
                capture: None,
            });
            let mut sequence = Sequence::of_panoramas("a", [64, 32], entries.collect());
            sequence.range = TimeRange::new(0.0, 2.0);
            sequence.faults()
        };
        assert!(sequence(&[("a", 0.0), ("b", 1.0), ("c", 1.0)]).is_empty());
        assert_eq!(sequence(&[("a", 0.0), ("a", 1.0)]).len(), 1);
        assert_eq!(sequence(&[("a", 1.0), ("b", 0.5), ("c", 1.5)]).len(), 1);
        assert_eq!(sequence(&[("a", 0.0), ("b", 2.0)]).len(), 1);
        assert_eq!(sequence(&[("a", f64::NAN), ("b", 1.0)]).len(), 1);
    }

    #[test]
    fn a_source_is_as_wide_as_its_panorama() {
        let mut sequence = Sequence::of_panoramas("a", [64, 32], Vec::new());
        sequence.probe = Probe::of_size([512, 1024]);
        sequence.probe.rotation_degrees = 90.0;
        assert_eq!(sequence.source_size(), (1024, 512));
        sequence.frames.converted_from = Some(SphereLayout::StereoLeftRight);
        assert_eq!(sequence.source_size(), (512, 256));
    }

    #[test]
    fn frames_of_no_or_of_endless_sides_are_refused() {
        let set = |width: u64| {
            let text = format!(
                r#"{{"width": {width}, "height": 8, "sampling": {{"max-frames": 3}},
                    "resampling": "none", "entries": []}}"#
            );
            serde_json::from_str::<FrameSet>(&text)
        };
        assert!(set(16).is_ok());
        for width in [0, 16_385, 4_294_967_295] {
            let message = set(width).map_or_else(|error| error.to_string(), |_| String::new());
            assert!(
                message.contains("the side of an image must be"),
                "{width}: {message}"
            );
        }
    }
}
