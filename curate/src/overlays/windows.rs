//! Passing captions: strokes that stay over two steps, in two windows at least, while their surroundings move.
//!
//! Over a whole shot a caption averages out; two steps are less than a second. Letters have many strong strokes close
//! together. Windows over a boundary do not count, and sightings count within one shot alone.

use omnilife_schemas::records::{Boundary, Overlay, OverlayClass, Sightings, TimeRange};

use super::{
    by_shot, moving_mosaics::is_at_same_place, parts::shot_at, regions::Grid, surroundings,
};

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
/// Share of a shot's windows from which on a caption is a sign that stays.
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

/// Sightings of captions in windows of two steps. Keeps the times of every window.
#[derive(Debug, Default)]
pub(super) struct WindowPass {
    last: Option<(TimeRange, Vec<StepPixel>)>,
    windows: Vec<TimeRange>,
    /// Finds, each with the time of its window as its range.
    seen: Vec<Overlay>,
}

impl WindowPass {
    /// Adds a step between the frames at the ends of a range; `None` if the scene did not move.
    pub(super) fn add(&mut self, range: TimeRange, step: Option<Vec<StepPixel>>, width: usize) {
        if let (Some((before, last)), Some(now)) = (&self.last, &step) {
            let window = TimeRange {
                begin_seconds: before.begin_seconds,
                end_seconds: range.end_seconds,
            };
            let found = find(last, now, width);
            self.windows.push(window);
            self.seen.extend(found.into_iter().map(|overlay| Overlay {
                ranges: vec![window],
                ..overlay
            }));
        }
        self.last = step.map(|step| (range, step));
    }

    /// Returns the captions, each once, with all windows and those in which it was seen.
    pub(super) fn captions(&self, boundaries: &[Boundary]) -> Vec<Overlay> {
        let is_in = |shot: usize, window: &TimeRange| {
            [window.begin_seconds, window.end_seconds]
                .iter()
                .all(|&seconds| shot_at(boundaries, seconds) == shot)
        };
        let mut found = Vec::new();
        for shot in 0..=boundaries.len() {
            let windows = self.windows.iter().filter(|window| is_in(shot, window));
            let seen = self
                .seen
                .iter()
                .filter(|overlay| (overlay.ranges.iter()).all(|window| is_in(shot, window)));
            for caption in captions_of_shot(seen, windows.count() as u32) {
                by_shot::add(&mut found, caption, |_, _| true);
            }
        }
        // Whether one passes is told by shot; limits on the time that a caption takes are of the video.
        for sightings in (found.iter_mut()).filter_map(|caption| caption.sightings.as_mut()) {
            sightings.looked_at_frames = self.windows.len() as u32;
        }
        found
    }
}

/// Returns the captions of one shot from its sightings, in order of time, among this many windows.
fn captions_of_shot<'a>(seen: impl Iterator<Item = &'a Overlay>, windows: u32) -> Vec<Overlay> {
    let mut found: Vec<(Overlay, u32)> = Vec::new();
    for seen in seen {
        match found
            .iter_mut()
            .find(|(known, _)| is_at_same_place(known, seen))
        {
            Some((known, count)) => {
                *count += 1;
                let ranges = spanned(&known.ranges, &seen.ranges);
                if seen.solid_angle_steradians > known.solid_angle_steradians {
                    *known = seen.clone();
                }
                known.ranges = ranges;
            }
            None => found.push((seen.clone(), 1)),
        }
    }
    let found = found
        .into_iter()
        .filter(|(_, count)| *count >= LEAST_SIGHTINGS);
    let named = found.map(|(overlay, count)| {
        let lasts = f64::from(count) >= LASTING_SHARE * f64::from(windows);
        Overlay {
            class: if lasts {
                OverlayClass::Watermark
            } else {
                OverlayClass::Caption
            },
            sightings: Some(Sightings {
                seen_frames: count,
                looked_at_frames: windows,
                reach_degrees: 0.0,
                block_pixels: 0.0,
            }),
            ..overlay
        }
    });
    named.collect()
}

/// Returns the one range from the first instant of some to the last of others; empty without any.
fn spanned(first: &[TimeRange], last: &[TimeRange]) -> Vec<TimeRange> {
    let ends = first.first().zip(last.last());
    let range = ends.map(|(first, last)| TimeRange {
        begin_seconds: first.begin_seconds,
        end_seconds: last.end_seconds,
    });
    range.into_iter().collect()
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
        ranges: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::BoundaryKind;
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
        captions_of(9, &[], is_shown)
    }

    fn captions_of(
        frames: usize,
        boundaries: &[Boundary],
        is_shown: impl Fn(usize) -> bool,
    ) -> Vec<Overlay> {
        let mut pass = OverlayPass::default();
        for number in 0..frames {
            pass.observe(number as f64 * 0.4, &frame(number, is_shown(number)));
        }
        pass.windows().captions(boundaries)
    }

    /// Subtitles that last for one shot and pass in the next.
    #[test]
    fn captions_in_one_place_of_two_shots_are_one() {
        let cut = Boundary {
            begin_seconds: 3.5,
            end_seconds: 3.6,
            kind: BoundaryKind::Cut,
            score: 1.0,
        };
        let found = captions_of(18, &[cut], |number| {
            number < 9 || (12..16).contains(&number)
        });
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].class, OverlayClass::Caption);
        assert_eq!(found[0].ranges.len(), 2);
        let seen = found[0].sightings.as_ref().map(|seen| seen.seen_frames);
        assert_eq!(seen, Some(7 + 2));
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
