//! Overlays of a video: parts that stay in the image while the scene moves, and mosaics that move with what they
//! hide. They are a part of `analysis`.

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::TimeRange;

/// All overlays of a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OverlayReport {
    /// Why nothing could be told, where that is so.
    pub unjudged: Option<String>,
    /// Looked-at pairs of frames between which the scene moved.
    pub moving_steps: u32,
    /// Overlays, the largest first.
    pub overlays: Vec<Overlay>,
    /// Shots, each judged alone, in order; empty in records of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spans: Vec<OverlaySpan>,
}

/// Looked-at frames of a shot, or of several that are judged together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OverlaySpan {
    /// From its first looked-at frame to its last.
    pub range: TimeRange,
    /// Number of its first shot, from 0.
    pub first_shot: u32,
    /// Number of shots that it holds: above 1 if the pass saw no candidate cut at a boundary. Content that stays in
    /// some of these shots alone is then missed or given the times of all.
    pub shots: u32,
    /// Looked-at pairs of frames in it between which the scene moved.
    pub moving_steps: u32,
    /// True if these are enough to tell what stays; false of a shot that is too short or still.
    pub is_judged: bool,
}

impl OverlayReport {
    /// Returns the spans in which an overlay stays, in order of time.
    pub fn spans_of<'a>(&'a self, overlay: &'a Overlay) -> impl Iterator<Item = &'a OverlaySpan> {
        let holds = |span: &TimeRange, range: &TimeRange| {
            range.begin_seconds < span.end_seconds && span.begin_seconds < range.end_seconds
        };
        (self.spans.iter())
            .filter(move |span| overlay.ranges.iter().any(|range| holds(&span.range, range)))
    }
}

/// A region of the sphere that stays, or a mosaic that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Overlay {
    /// Kind of overlay.
    pub class: OverlayClass,
    /// Longitude of its centre, degrees from the image's middle, positive to the right.
    pub longitude_degrees: f64,
    /// Latitude of its centre, degrees, positive upwards.
    pub latitude_degrees: f64,
    /// Its size; the whole sphere has 4 pi.
    pub solid_angle_steradians: f64,
    /// Width in longitude and height in latitude of the rectangle that it fills, degrees; `None` for other shapes, which
    /// are taken for discs of their size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extent_degrees: Option<[f64; 2]>,
    /// Length of the mean gradient over the mean length of the gradient: 1 where nothing changes, 0
    /// in dynamic regions.
    pub constancy: f64,
    /// Share of its details that stay from one look to the next; 0 in dynamic regions.
    pub stayed: f64,
    /// Mean gradient on its edges, 8-bit levels per pixel.
    pub strength_levels: f64,
    /// Standard deviation of its luminance over time, 8-bit levels.
    pub variation_levels: f64,
    /// Share of it that is nearly black or nearly white.
    pub saturated_share: f64,
    /// Single frames in which a moving overlay was seen, with position and size as means over those; or frames for which a
    /// caption stayed.
    pub sightings: Option<Sightings>,
    /// Times at which it stays, from the first looked-at frame to the last; empty for moving mosaics, which are seen in
    /// single frames.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<TimeRange>,
}

impl Overlay {
    /// Returns true if its rectangle or disc covers a direction, in degrees as for its centre.
    pub fn covers(&self, longitude_degrees: f64, latitude_degrees: f64) -> bool {
        let east = (longitude_degrees - self.longitude_degrees).to_radians();
        if let Some([width, height]) = self.extent_degrees {
            let across = (east.to_degrees() + 180.0).rem_euclid(360.0) - 180.0;
            let along = latitude_degrees - self.latitude_degrees;
            return across.abs() <= 0.5 * width && along.abs() <= 0.5 * height;
        }
        let [north, centre] =
            [latitude_degrees, self.latitude_degrees].map(|degrees| degrees.to_radians().sin_cos());
        let cosine = north.0 * centre.0 + north.1 * centre.1 * east.cos();
        cosine >= self.disc_cosine()
    }

    /// Returns half of its width in longitude and half of its height in latitude, degrees.
    pub fn reach_degrees(&self) -> [f64; 2] {
        if let Some(extent) = self.extent_degrees {
            return extent.map(|side| 0.5 * side);
        }
        let angle = self.disc_cosine().clamp(-1.0, 1.0).acos().to_degrees();
        let stretch = self.latitude_degrees.to_radians().cos().max(1e-3);
        [(angle / stretch).min(180.0), angle]
    }

    /// Returns the cosine of the half angle of a disc of its size: a cap of half angle a has 2 pi (1 - cos a).
    fn disc_cosine(&self) -> f64 {
        1.0 - self.solid_angle_steradians / TAU
    }
}

/// The frames in which a moving mosaic was seen, or for which a caption stayed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sightings {
    /// Frames in which it was seen.
    pub seen_frames: u32,
    /// Frames that were looked at, spread over the video.
    pub looked_at_frames: u32,
    /// Greatest angle between its centre in a frame and its mean centre, degrees.
    pub reach_degrees: f64,
    /// Side of its blocks in pixels of the video, the median over frames; 0 for a caption.
    pub block_pixels: f64,
}

impl Sightings {
    /// Returns the share of the sampled frames in which it was seen.
    pub fn share(&self) -> f64 {
        f64::from(self.seen_frames) / f64::from(self.looked_at_frames.max(1))
    }
}

/// Kind of an overlay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OverlayClass {
    /// A sign or logo that stays over the whole video.
    Watermark,
    /// Lines of text that change.
    Caption,
    /// A painted disc over the nadir.
    NadirPatch,
    /// A grid of blocks in place of the image.
    Mosaic,
    /// Part of the camera or its bearer: a tripod, a helmet, a vehicle.
    Rig,
}

impl OverlayClass {
    /// Returns whether it hides reconstructable content or adds patterns that are not in the scene. A patch over the
    /// nadir hides the tripod, so it does not count.
    pub fn spoils_geometry(self) -> bool {
        matches!(self, Self::Watermark | Self::Caption | Self::Mosaic)
    }

    /// Returns the name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Watermark => "watermark",
            Self::Caption => "caption",
            Self::NadirPatch => "nadir-patch",
            Self::Mosaic => "mosaic",
            Self::Rig => "rig",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlay(solid_angle_steradians: f64, extent_degrees: Option<[f64; 2]>) -> Overlay {
        Overlay {
            class: OverlayClass::Caption,
            longitude_degrees: 178.0,
            latitude_degrees: 10.0,
            solid_angle_steradians,
            extent_degrees,
            constancy: 1.0,
            stayed: 1.0,
            strength_levels: 50.0,
            variation_levels: 0.0,
            saturated_share: 0.0,
            sightings: None,
            ranges: Vec::new(),
        }
    }

    #[test]
    fn rectangles_and_discs_go_on_over_the_seam() {
        let text = overlay(0.1, Some([30.0, 8.0]));
        assert!(text.covers(-168.0, 13.0) && text.covers(164.0, 7.0));
        assert!(!text.covers(-166.0, 10.0) && !text.covers(178.0, 15.0));
        assert_eq!(text.reach_degrees(), [15.0, 4.0]);
        // A disc of 5 degrees.
        let disc = overlay(TAU * (1.0 - 5.0_f64.to_radians().cos()), None);
        assert!(disc.covers(-177.1, 10.0) && disc.covers(178.0, 14.9));
        assert!(!disc.covers(-176.8, 10.0) && !disc.covers(178.0, 15.1));
        let [width, height] = disc.reach_degrees();
        assert!((height - 5.0).abs() < 1e-9 && (width - 5.077).abs() < 1e-3);
    }
}
