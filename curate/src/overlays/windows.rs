//! Passing captions: strokes that stay over two steps, in two windows at least, while their surroundings move.
//!
//! Over a whole video a caption averages out. Two steps are less than a second, and lie within one shot: nothing but what
//! is painted over the image stays across a cut. Letters have many strong strokes close together.

use omnilife_schemas::records::{Overlay, OverlayClass, Sightings};

use super::{moving_mosaics::is_at_same_place, regions::Grid, surroundings};

/// Least mean gradient of a stroke, 8-bit levels per pixel.
const LEAST_STROKE: f32 = 16.0;
/// Strokes of one caption are at most this many pixels apart.
const REACH_PIXELS: usize = 6;
/// Least share of strokes in a caption, and least area of its strokes, steradians. Painted captions have
/// 0.15 to 0.4, and 0.016 or more. Other regions of the same clips have less than one of the limits.
const LEAST_DENSITY: f64 = 0.14;
const LEAST_STROKE_STERADIANS: f64 = 6e-3;
/// Captions are not read at the poles: largest latitude of their middle, degrees.
const LARGEST_LATITUDE_DEGREES: f64 = 60.0;
/// Least number of windows in which a caption is seen. A skyline far ahead stays for one while the near things move.
const LEAST_SIGHTINGS: u32 = 2;
/// Share of all windows from which on a caption is a sign that stays.
const LASTING_SHARE: f64 = 0.8;

/// One pixel over a step, between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepPixel {
    /// True if there was detail.
    pub(super) is_detailed: bool,
    /// True if the detail stayed.
    pub(super) stayed: bool,
    /// Mean differences to the pixels to the right and below.
    pub(super) gradient: [f32; 2],
    /// Mean luminance.
    pub(super) level: f32,
}

impl StepPixel {
    fn strength(&self) -> f32 {
        self.gradient[0].hypot(self.gradient[1])
    }

    fn is_stroke(&self) -> bool {
        self.stayed && self.strength() >= LEAST_STROKE
    }
}

/// Sightings of captions in windows of two steps.
#[derive(Debug, Default)]
pub(super) struct WindowPass {
    last: Option<Vec<StepPixel>>,
    windows: u32,
    seen: Vec<Overlay>,
}

impl WindowPass {
    /// Adds a step between two frames; `None` if the scene did not move.
    pub(super) fn add(&mut self, step: Option<Vec<StepPixel>>, width: usize) {
        if let (Some(last), Some(now)) = (&self.last, &step) {
            self.windows += 1;
            self.seen.extend(find(last, now, width));
        }
        self.last = step;
    }

    /// Returns the captions, each once, with the windows in which it was seen.
    pub(super) fn captions(&self) -> Vec<Overlay> {
        let mut found: Vec<(Overlay, u32)> = Vec::new();
        for seen in &self.seen {
            match found
                .iter_mut()
                .find(|(known, _)| is_at_same_place(known, seen))
            {
                Some((known, count)) => {
                    *count += 1;
                    if seen.solid_angle_steradians > known.solid_angle_steradians {
                        *known = seen.clone();
                    }
                }
                None => found.push((seen.clone(), 1)),
            }
        }
        let found = found
            .into_iter()
            .filter(|(_, count)| *count >= LEAST_SIGHTINGS);
        let named = found.map(|(overlay, count)| {
            let lasts = f64::from(count) >= LASTING_SHARE * f64::from(self.windows);
            Overlay {
                class: if lasts {
                    OverlayClass::Watermark
                } else {
                    OverlayClass::Caption
                },
                sightings: Some(Sightings {
                    seen_frames: count,
                    looked_at_frames: self.windows,
                    reach_degrees: 0.0,
                    block_pixels: 0.0,
                }),
                ..overlay
            }
        });
        named.collect()
    }
}

/// Finds the captions of two steps that follow each other.
fn find(first: &[StepPixel], second: &[StepPixel], width: usize) -> Vec<Overlay> {
    let grid = Grid {
        width,
        height: first.len() / width.max(1),
    };
    let both = |at: usize| [&first[at], &second[at]];
    let strokes: Vec<bool> = (0..first.len())
        .map(|at| both(at).iter().all(|pixel| pixel.is_stroke()))
        .collect();
    let is_detailed = |at: usize| both(at).iter().any(|pixel| pixel.is_detailed);
    let stays = |at: usize| {
        both(at)
            .iter()
            .all(|pixel| pixel.stayed || !pixel.is_detailed)
    };
    let regions = grid.regions(&strokes, REACH_PIXELS);
    let captions = regions.iter().filter_map(|region| {
        let overlay = caption(&grid, &region.pixels, &strokes, both)?;
        surroundings::are_moving(&grid, &region.pixels, is_detailed, stays).then_some(overlay)
    });
    captions.collect()
}

/// Returns a region with as many strokes as letters have.
fn caption<'a>(
    grid: &Grid,
    region: &[usize],
    strokes: &[bool],
    both: impl Fn(usize) -> [&'a StepPixel; 2],
) -> Option<Overlay> {
    let (mut area, mut direction, mut extreme) = (0.0, [0.0; 3], 0.0);
    let (mut marked, mut strength, mut constancy, mut variation) = (0.0, 0.0, 0.0, 0.0);
    for &at in region {
        let (x, y) = (at % grid.width, at / grid.width);
        let (longitude, latitude) = (grid.longitude(x), grid.latitude(y));
        let steradians = grid.steradians(y);
        let [a, b] = both(at);
        area += steradians;
        direction[0] += steradians * latitude.cos() * longitude.sin();
        direction[1] += steradians * latitude.sin();
        direction[2] += steradians * latitude.cos() * longitude.cos();
        variation += steradians * 0.5 * f64::from((a.level - b.level).abs());
        if !(25.0..=230.0).contains(&(0.5 * (a.level + b.level))) {
            extreme += steradians;
        }
        if strokes[at] {
            let sum = [0, 1].map(|axis| a.gradient[axis] + b.gradient[axis]);
            let lengths = a.strength() + b.strength();
            marked += steradians;
            strength += steradians * 0.5 * f64::from(lengths);
            constancy += steradians * f64::from(sum[0].hypot(sum[1]) / lengths);
        }
    }
    let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
    let latitude = (direction[1] / length.max(1e-12)).clamp(-1.0, 1.0).asin();
    let is_caption = marked >= LEAST_STROKE_STERADIANS
        && marked >= LEAST_DENSITY * area
        && latitude.to_degrees().abs() <= LARGEST_LATITUDE_DEGREES;
    is_caption.then(|| Overlay {
        class: OverlayClass::Caption,
        longitude_degrees: direction[0].atan2(direction[2]).to_degrees(),
        latitude_degrees: latitude.to_degrees(),
        solid_angle_steradians: area,
        constancy: constancy / marked,
        stayed: 1.0,
        strength_levels: strength / marked,
        variation_levels: variation / area,
        saturated_share: extreme / area,
        sightings: None,
    })
}

#[cfg(test)]
mod tests {
    use omnilife_video::Rgb8Image;

    use super::super::OverlayPass;
    use super::*;

    const WIDTH: usize = 512;
    const HEIGHT: usize = 256;

    /// Grain that is another one in every frame, with strokes of letters in a box if there is a caption.
    fn frame(number: usize, has_caption: bool) -> Rgb8Image {
        let level = |at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            if has_caption && (200..280).contains(&x) && (120..136).contains(&y) {
                return if (x / 3).is_multiple_of(2) { 250 } else { 10 };
            }
            let mixed = (at + 1).wrapping_mul(2_654_435_761) ^ (number + 1).wrapping_mul(40_503);
            let mixed = mixed.wrapping_mul(mixed | 1);
            ((mixed >> 13) % 200) as u8
        };
        Rgb8Image::new(
            WIDTH,
            HEIGHT,
            (0..WIDTH * HEIGHT).flat_map(|at| [level(at); 3]).collect(),
        )
    }

    fn captions(is_shown: impl Fn(usize) -> bool) -> Vec<Overlay> {
        let mut pass = OverlayPass::default();
        for number in 0..9 {
            pass.observe(number as f64 * 0.4, &frame(number, is_shown(number)));
        }
        pass.windows().captions()
    }

    #[test]
    fn a_passing_caption_is_found_and_a_lasting_one_is_a_sign() {
        assert!(captions(|_| false).is_empty());
        let short = captions(|number| (3..7).contains(&number));
        assert_eq!(short.len(), 1, "{short:?}");
        assert_eq!(short[0].class, OverlayClass::Caption);
        // Columns 200 to 280 of 512, rows 120 to 136 of 256.
        assert!((short[0].longitude_degrees + 11.25).abs() < 3.0);
        assert!(short[0].latitude_degrees.abs() < 3.0);
        let lasting = captions(|_| true);
        assert_eq!(lasting.len(), 1, "{lasting:?}");
        assert_eq!(lasting[0].class, OverlayClass::Watermark);
    }
}
