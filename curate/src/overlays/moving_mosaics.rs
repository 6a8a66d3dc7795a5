//! Mosaics that follow the content they hide: found in single frames, reported for whole videos.

use std::{
    f64::consts::{PI, TAU},
    path::Path,
};

use ffmpeg_next::frame;
use omnilife_schemas::{
    records::{Overlay, OverlayClass, Sightings},
    statistics,
};
use omnilife_video::LumaImage;

use super::{
    blocks::{Area, Patch},
    pixelation::{PixelationFinder, margin_pixels},
};
use crate::error::CurateError;

/// Interval of the frames examined at full size, seconds. The cost grows with their pixels: above two million of them
/// the interval is longer.
const STEP_SECONDS: f64 = 0.8;
const MOST_STEP_SECONDS: f64 = 2.4;
const PIXELS_OF_STEP: f64 = 2048.0 * 1024.0;
/// Least number of frames in which a reported mosaic was seen; chance does not repeat itself so often.
const LEAST_SEEN_FRAMES: usize = 3;

/// Finds pixelation in frames of a video. Keeps a few numbers per frame with any.
#[derive(Debug, Default)]
pub struct MosaicPass {
    next_seconds: Option<f64>,
    image: LumaImage,
    finder: PixelationFinder,
    looked_at_frames: u32,
    seen: Vec<SeenFrame>,
}

/// Summary of one frame's mosaics.
#[derive(Debug, Clone, Copy)]
struct SeenFrame {
    steradians: f64,
    /// Mean of the directions to its parts, weighted by their size.
    direction: [f64; 3],
    block_pixels: f64,
    /// Means over the parts, weighted by their size.
    step_levels: f64,
    level: f64,
    saturated_share: f64,
}

/// Returns the interval of examined frames for images of this size.
fn step_seconds(width: u32, height: u32) -> f64 {
    let pixels = f64::from(width) * f64::from(height);
    (STEP_SECONDS * pixels / PIXELS_OF_STEP).clamp(STEP_SECONDS, MOST_STEP_SECONDS)
}

impl MosaicPass {
    /// Returns true if the frame at this time is to be examined.
    pub(crate) fn wants(&self, time_seconds: f64) -> bool {
        self.next_seconds.is_none_or(|next| time_seconds >= next)
    }

    /// Examines a frame of the video at `path`, turned clockwise by quarter turns.
    ///
    /// # Errors
    /// [`CurateError::Video`] when the pixel format cannot be converted.
    pub(crate) fn observe(
        &mut self,
        path: &Path,
        time_seconds: f64,
        frame: &frame::Video,
        quarter_turns: u32,
    ) -> Result<(), CurateError> {
        self.next_seconds = Some(time_seconds + step_seconds(frame.width(), frame.height()));
        self.image.read(path, frame, quarter_turns, margin_pixels)?;
        self.look();
        Ok(())
    }

    fn look(&mut self) {
        self.looked_at_frames += 1;
        let patches = self.finder.find(&self.image);
        let size = (self.image.width, self.image.height);
        self.seen.extend(SeenFrame::of(&patches, size));
    }

    /// Returns the mosaic of the video, if it has one.
    pub(super) fn overlay(&self) -> Option<Overlay> {
        if self.seen.len() < LEAST_SEEN_FRAMES {
            return None;
        }
        let mean = |of: fn(&SeenFrame) -> f64| {
            self.seen.iter().map(of).sum::<f64>() / self.seen.len() as f64
        };
        let centre = unit([
            mean(|seen| seen.direction[0]),
            mean(|seen| seen.direction[1]),
            mean(|seen| seen.direction[2]),
        ]);
        let reach = self
            .seen
            .iter()
            .map(|seen| angle(unit(seen.direction), centre))
            .fold(0.0, f64::max);
        let blocks: Vec<f64> = self.seen.iter().map(|seen| seen.block_pixels).collect();
        let level = mean(|seen| seen.level);
        let variance = self
            .seen
            .iter()
            .map(|seen| (seen.level - level).powi(2))
            .sum::<f64>()
            / self.seen.len() as f64;
        Some(Overlay {
            class: OverlayClass::Mosaic,
            longitude_degrees: centre[0].atan2(centre[2]).to_degrees(),
            latitude_degrees: centre[1].clamp(-1.0, 1.0).asin().to_degrees(),
            solid_angle_steradians: mean(|seen| seen.steradians),
            extent_degrees: None,
            constancy: 0.0,
            stayed: 0.0,
            strength_levels: mean(|seen| seen.step_levels),
            variation_levels: variance.sqrt(),
            saturated_share: mean(|seen| seen.saturated_share),
            sightings: Some(Sightings {
                seen_frames: self.seen.len() as u32,
                looked_at_frames: self.looked_at_frames,
                reach_degrees: reach.to_degrees(),
                block_pixels: statistics::median(&blocks)?,
            }),
            ranges: Vec::new(),
        })
    }
}

/// Returns true if the mosaic seen in single frames is this one, which stays in place.
pub(super) fn is_same(standing: &Overlay, seen: &Overlay) -> bool {
    standing.class == OverlayClass::Mosaic && is_at_same_place(standing, seen)
}

/// Returns true if the middle of one overlay lies within a disc of the other one's size, or the other way around.
pub(super) fn is_at_same_place(one: &Overlay, other: &Overlay) -> bool {
    let direction = |overlay: &Overlay| {
        let (longitude, latitude) = (
            overlay.longitude_degrees.to_radians(),
            overlay.latitude_degrees.to_radians(),
        );
        [
            latitude.cos() * longitude.sin(),
            latitude.sin(),
            latitude.cos() * longitude.cos(),
        ]
    };
    // Radius of a disc of that size.
    let radius = |overlay: &Overlay| (overlay.solid_angle_steradians / PI).sqrt();
    angle(direction(one), direction(other)) <= radius(one).max(radius(other))
}

impl SeenFrame {
    /// Returns `None` for a frame of this size without patches.
    fn of(patches: &[Patch], size: (usize, usize)) -> Option<Self> {
        let largest = patches
            .iter()
            .max_by_key(|p| p.area.width * p.area.height)?;
        let mut all = Self {
            steradians: 0.0,
            direction: [0.0; 3],
            block_pixels: f64::from(largest.block_pixels),
            step_levels: 0.0,
            level: 0.0,
            saturated_share: 0.0,
        };
        for patch in patches {
            let steradians = steradians(&patch.area, size);
            let direction = direction(&patch.area, size);
            all.steradians += steradians;
            for (sum, part) in all.direction.iter_mut().zip(direction) {
                *sum += steradians * part;
            }
            all.step_levels += steradians * f64::from(patch.step_levels);
            all.level += steradians * f64::from(patch.level);
            all.saturated_share += steradians * f64::from(patch.saturated_share);
        }
        all.direction = all.direction.map(|sum| sum / all.steradians);
        all.step_levels /= all.steradians;
        all.level /= all.steradians;
        all.saturated_share /= all.steradians;
        Some(all)
    }
}

/// Returns the latitude of the upper border of a row, radians.
fn latitude(y: f64, height: usize) -> f64 {
    (0.5 - y / height as f64) * PI
}

fn steradians(area: &Area, (width, height): (usize, usize)) -> f64 {
    let top = latitude(area.top as f64, height);
    let bottom = latitude((area.top + area.height) as f64, height);
    area.width as f64 / width as f64 * TAU * (top.sin() - bottom.sin())
}

/// Returns the direction of the middle of a rectangle: x right, y up, z to the image's middle.
fn direction(area: &Area, (width, height): (usize, usize)) -> [f64; 3] {
    let x = area.left as f64 + 0.5 * area.width as f64;
    let longitude = (x / width as f64 - 0.5) * TAU;
    let latitude = latitude(area.top as f64 + 0.5 * area.height as f64, height);
    [
        latitude.cos() * longitude.sin(),
        latitude.sin(),
        latitude.cos() * longitude.cos(),
    ]
}

fn unit(vector: [f64; 3]) -> [f64; 3] {
    let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-12);
    vector.map(|c| c / length)
}

fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    cosine.clamp(-1.0, 1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlays::pixelation::textured;

    const WIDTH: usize = 512;
    const HEIGHT: usize = 256;

    #[test]
    fn large_images_are_looked_at_more_rarely() {
        let steps = [(1024, 512), (2048, 1024), (2880, 1440), (8192, 4096)]
            .map(|(width, height)| step_seconds(width, height));
        assert_eq!([steps[0], steps[1], steps[3]], [0.8, 0.8, 2.4]);
        assert!((steps[2] - 1.582).abs() < 1e-3);
    }

    /// A box of 8-pixel blocks goes over the seam; every frame has another texture around it.
    #[test]
    fn a_box_that_moves_over_the_seam_is_one_mosaic() {
        let mut pass = MosaicPass::default();
        for frame in 0..6_usize {
            let left = (WIDTH - 64 + 12 * frame) % WIDTH;
            let levels = textured((WIDTH, HEIGHT), frame as u32, |x, y| {
                let from_left = (x + WIDTH - left) % WIDTH;
                let inside = from_left < 64 && (96..160).contains(&y) && frame != 3;
                inside.then(|| (from_left / 8, (y - 96) / 8))
            });
            pass.image
                .fill((WIDTH, HEIGHT), margin_pixels, levels.chunks(WIDTH));
            pass.look();
        }
        let overlay = pass.overlay().expect("found");
        let sightings = overlay.sightings.as_ref().expect("seen in single frames");
        assert_eq!((sightings.seen_frames, sightings.looked_at_frames), (5, 6));
        assert!((sightings.block_pixels - 8.0).abs() < 0.1);
        // Its middle goes from 32 pixels left of the seam to 28 right of it.
        let expected = (-32.0 - 20.0 - 8.0 + 16.0 + 28.0) / 5.0 / WIDTH as f64 * 360.0 + 180.0;
        // A column of blocks that is missed at its border moves its middle by half a block.
        let half_block = 4.0 / WIDTH as f64 * 360.0;
        assert!(
            (overlay.longitude_degrees - expected).abs() <= half_block,
            "{overlay:#?}"
        );
        assert!(overlay.latitude_degrees.abs() < 1.0);
        let truth = 64.0 / WIDTH as f64 * TAU * 2.0 * (0.125 * PI).sin();
        assert!((overlay.solid_angle_steradians - truth).abs() < 0.1 * truth);
        assert!((15.0..30.0).contains(&sightings.reach_degrees));
        pass.seen.truncate(2);
        assert_eq!(pass.overlay(), None);
    }
}
