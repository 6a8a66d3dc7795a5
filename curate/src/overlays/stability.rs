//! Per-pixel stability of the image while the scene moves.

use omnilife_schemas::records::{Boundary, Overlay, TimeRange};
use omnilife_video::Rgb8Image;

use super::{
    LEAST_MOVING_STEPS,
    captions::CaptionPass,
    cuts::CutSignal,
    parts::{self, Part, Parts},
    regions,
};

/// Interval of the examined frames, seconds: a caption of a second has four of them.
const SAMPLE_SECONDS: f64 = 0.2;
/// Interval of the compared frames, seconds: long enough for a walking camera to move the image.
const STEP_SECONDS: f64 = 0.4;
/// Gradient, in 8-bit levels per pixel, from which a pixel has detail.
const DETAIL_LEVELS: f32 = 6.0;
/// A gradient is stable when it changed by less than this share of its length.
const STAYED_SHARE: f32 = 0.35;
/// The scene moved between two frames when at most this share of the detail stayed.
const STILL_SHARE: f64 = 0.5;

/// Accumulates over a video; memory does not grow with its length, except for the times and groups of captions.
#[derive(Debug, Default)]
pub struct OverlayPass {
    width: usize,
    height: usize,
    next_sample_seconds: Option<f64>,
    next_step_seconds: Option<f64>,
    last: Vec<Sample>,
    last_seconds: f64,
    cuts: CutSignal,
    parts: Parts<StepSums>,
    /// Compared pairs of frames of the whole video.
    steps: u32,
    captions: CaptionPass,
}

/// Frames of a shot, or of several that are judged together.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// From its first looked-at frame to its last.
    pub(super) range: TimeRange,
    pub(super) moving_steps: u32,
    /// Regions that stay; `None` if too few steps moved.
    pub(super) overlays: Option<Vec<Overlay>>,
}

/// All pixels over some steps.
#[derive(Debug, Default)]
struct StepSums {
    moving_steps: u32,
    /// Empty before the scene moves.
    pixels: Vec<Sums>,
}

/// One pixel of one frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sample {
    pub(super) level: f32,
    /// Differences to the pixels to the right and below.
    pub(super) gradient: [f32; 2],
}

impl Sample {
    pub(super) fn strength(&self) -> f32 {
        length(self.gradient)
    }
}

/// One pixel over the frames before and after which the scene moved.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    gradient: [f32; 2],
    strength: f32,
    absolute: [f32; 2],
    level: f32,
    level_squared: f32,
    /// Steps at which there was detail, and those of them at which it stayed.
    detailed: u16,
    stayed: u16,
}

/// Result of a pass, per pixel of an image of this size.
pub(super) struct Stability {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<PixelStability>,
}

/// Behaviour of a pixel over time.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelStability {
    /// Length of the mean gradient over the mean length of the gradient: 1 where it never changes.
    pub(super) constancy: f32,
    /// Mean length of the gradient, 8-bit levels per pixel.
    pub(super) strength: f32,
    /// Share of the steps with detail at which the detail was stable; 0 if most have none.
    pub(super) stayed: f32,
    /// Mean absolute differences to the pixels to the right and below.
    pub(super) absolute: [f32; 2],
    /// Standard deviation of the luminance over time.
    pub(super) variation: f32,
    /// Mean luminance.
    pub(super) level: f32,
}

impl OverlayPass {
    /// Returns true if the frame at this time is to be examined.
    pub(crate) fn wants(&self, time_seconds: f64) -> bool {
        is_due(self.next_sample_seconds, time_seconds)
    }

    /// Examines a frame, about 512 pixels wide.
    pub(crate) fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) {
        self.next_sample_seconds = Some(time_seconds + SAMPLE_SECONDS);
        let samples = samples(image);
        // A change of size restarts it.
        let is_first = (image.width, image.height) != (self.width, self.height);
        if is_first {
            *self = Self {
                width: image.width,
                height: image.height,
                next_sample_seconds: self.next_sample_seconds,
                ..Self::default()
            };
        }
        self.captions.add(time_seconds, &samples, image.width);
        if !is_due(self.next_step_seconds, time_seconds) {
            return;
        }
        self.next_step_seconds = Some(time_seconds + STEP_SECONDS);
        let cut = self.cuts.candidate(image.width, levels(&samples));
        if !is_first {
            self.compare(time_seconds, &samples, cut);
        }
        self.last = samples;
        self.last_seconds = time_seconds;
    }

    /// Adds the step from the last frame to this one, with the score of a candidate cut between them.
    fn compare(&mut self, time_seconds: f64, samples: &[Sample], cut: Option<f64>) {
        self.steps += 1;
        let mut detailed = 0_u64;
        let mut stayed = 0_u64;
        for (before, now) in self.last.iter().zip(samples) {
            let strength = before.strength().max(now.strength());
            if strength >= DETAIL_LEVELS {
                detailed += 1;
                stayed += u64::from(has_stayed(before, now, strength));
            }
        }
        let is_moving = (stayed as f64) <= STILL_SHARE * detailed as f64 && detailed > 0;
        let range = TimeRange::new(self.last_seconds, time_seconds);
        self.parts.add(range, cut, |sums| {
            if is_moving {
                sums.add(&self.last, samples);
            }
        });
    }

    /// Returns the search for captions that pass.
    pub(super) fn captions(&self) -> &CaptionPass {
        &self.captions
    }

    /// Returns the number of compared pairs of frames.
    pub(super) fn steps(&self) -> u32 {
        self.steps
    }

    /// Returns the judged shots in order of time; empty without a compared pair of frames.
    pub(super) fn pieces(&self, boundaries: &[Boundary]) -> Vec<Piece> {
        self.parts.by_shot(boundaries, |shot| self.piece(shot))
    }

    fn piece(&self, shot: &Part<StepSums>) -> Piece {
        let is_judged = shot.sums.moving_steps >= LEAST_MOVING_STEPS;
        Piece {
            range: shot.range,
            moving_steps: shot.sums.moving_steps,
            overlays: is_judged.then(|| regions::find(&self.stability(&shot.sums))),
        }
    }

    fn stability(&self, sums: &StepSums) -> Stability {
        let count = sums.moving_steps as f32;
        Stability {
            width: self.width,
            height: self.height,
            pixels: sums
                .pixels
                .iter()
                .map(|sums| sums.stability(count))
                .collect(),
        }
    }
}

impl StepSums {
    /// Adds a step between two frames.
    fn add(&mut self, before: &[Sample], now: &[Sample]) {
        self.moving_steps += 1;
        self.pixels.resize(now.len(), Sums::default());
        for ((sums, before), now) in self.pixels.iter_mut().zip(before).zip(now) {
            sums.add(before, now);
        }
    }
}

impl parts::Sums for StepSums {
    fn join(&mut self, later: &Self) {
        self.moving_steps += later.moving_steps;
        if self.pixels.is_empty() {
            self.pixels.clone_from(&later.pixels);
            return;
        }
        for (sums, later) in self.pixels.iter_mut().zip(&later.pixels) {
            sums.join(later);
        }
    }
}

impl Sums {
    fn add(&mut self, before: &Sample, now: &Sample) {
        for axis in 0..2 {
            self.gradient[axis] += now.gradient[axis];
            self.absolute[axis] += now.gradient[axis].abs();
        }
        self.strength += now.strength();
        self.level += now.level;
        self.level_squared += now.level * now.level;
        let strength = before.strength().max(now.strength());
        if strength >= DETAIL_LEVELS {
            self.detailed = self.detailed.saturating_add(1);
            if has_stayed(before, now, strength) {
                self.stayed = self.stayed.saturating_add(1);
            }
        }
    }

    fn join(&mut self, later: &Self) {
        for axis in 0..2 {
            self.gradient[axis] += later.gradient[axis];
            self.absolute[axis] += later.absolute[axis];
        }
        self.strength += later.strength;
        self.level += later.level;
        self.level_squared += later.level_squared;
        self.detailed = self.detailed.saturating_add(later.detailed);
        self.stayed = self.stayed.saturating_add(later.stayed);
    }

    fn stability(&self, count: f32) -> PixelStability {
        let mean = self.level / count;
        PixelStability {
            constancy: self.gradient[0].hypot(self.gradient[1]) / self.strength.max(1e-3),
            strength: self.strength / count,
            // Intermittent detail does not belong to an overlay.
            stayed: if 2.0 * f32::from(self.detailed) >= count {
                f32::from(self.stayed) / f32::from(self.detailed.max(1))
            } else {
                0.0
            },
            absolute: self.absolute.map(|sum| sum / count),
            variation: (self.level_squared / count - mean * mean).max(0.0).sqrt(),
            level: mean,
        }
    }
}

/// Levels are far from where squares overflow: no need of `hypot`, which takes ten times as long.
fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

fn has_stayed(before: &Sample, now: &Sample, strength: f32) -> bool {
    let change = [0, 1].map(|axis| now.gradient[axis] - before.gradient[axis]);
    length(change) <= STAYED_SHARE * strength
}

/// Returns true at a time or later, but for rounding of times.
fn is_due(next_seconds: Option<f64>, time_seconds: f64) -> bool {
    next_seconds.is_none_or(|next| time_seconds >= next - 1e-6)
}

fn levels(samples: &[Sample]) -> impl Iterator<Item = f32> {
    samples.iter().map(|sample| sample.level)
}

fn samples(image: &Rgb8Image) -> Vec<Sample> {
    let (width, height) = (image.width, image.height);
    let levels: Vec<f32> = image
        .data
        .as_chunks::<3>()
        .0
        .iter()
        .map(|&[red, green, blue]| {
            0.299 * f32::from(red) + 0.587 * f32::from(green) + 0.114 * f32::from(blue)
        })
        .collect();
    (0..width * height)
        .map(|at| {
            let (x, y) = (at % width, at / width);
            // The sphere goes on over the seam and ends at the poles.
            let right = y * width + (x + 1) % width;
            let below = if y + 1 < height { at + width } else { at };
            Sample {
                level: levels[at],
                gradient: [levels[right] - levels[at], levels[below] - levels[at]],
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{parts::Sums as _, *};

    /// Levels of a frame of 64 x 32 pixels, others in every frame.
    fn frame(number: usize) -> Vec<Sample> {
        let level = |at: usize| {
            let mixed = (at + 1).wrapping_mul(2_654_435_761) ^ (number + 1).wrapping_mul(40_503);
            let mixed = mixed.wrapping_mul(mixed | 1);
            ((mixed >> 13) % 200) as u8
        };
        let data = (0..64 * 32).flat_map(|at| [level(at); 3]).collect();
        samples(&Rgb8Image::new(64, 32, data))
    }

    fn summed(frames: &[Vec<Sample>]) -> StepSums {
        let mut sums = StepSums::default();
        for pair in frames.windows(2) {
            sums.add(&pair[0], &pair[1]);
        }
        sums
    }

    /// Halves of no steps, of one, and of many.
    #[test]
    fn joined_sums_are_those_of_all_steps() {
        let frames: Vec<Vec<Sample>> = (0..9).map(frame).collect();
        let whole = summed(&frames);
        for cut in [0, 1, 4, 8] {
            let mut joined = StepSums::default();
            joined.join(&summed(&frames[..=cut]));
            joined.join(&summed(&frames[cut..]));
            assert_eq!(joined.moving_steps, whole.moving_steps);
            assert_eq!(joined.pixels.len(), whole.pixels.len());
            for (one, other) in joined.pixels.iter().zip(&whole.pixels) {
                let near = |one: f32, other: f32, scale: f32| {
                    assert!(
                        (one - other).abs() <= 1e-6 * scale,
                        "{one} {other} at {cut}"
                    );
                };
                for axis in 0..2 {
                    near(
                        one.gradient[axis],
                        other.gradient[axis],
                        other.absolute[axis],
                    );
                    near(
                        one.absolute[axis],
                        other.absolute[axis],
                        other.absolute[axis],
                    );
                }
                near(one.strength, other.strength, other.strength);
                near(one.level, other.level, other.level);
                near(one.level_squared, other.level_squared, other.level_squared);
                assert_eq!((one.detailed, one.stayed), (other.detailed, other.stayed));
            }
        }
    }
}
