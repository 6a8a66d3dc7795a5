//! Frames that show the picture of the frame before: video at a rate that its camera did not have.
//!
//! A repetition is coded anew, so it differs by what compression leaves. It counts as one if that is little beside the
//! steps on both of its sides. A camera that stands still has small steps throughout.

use omnilife_video::Rgb8Image;

/// Step of a repetition over the largest steps beside it. Over five clips of cameras and four rendered ones the rule
/// finds no frame at 0.2 or less; of 10, 15 and 24 frames a second stored as 30 it finds all repeated ones but the last
/// at 0.1 (`scripts/calibrate/repetitions.py`).
const LARGEST_RATIO: f64 = 0.1;
/// Steps on either side among which the largest counts, since a picture may be repeated twice.
const REACH: usize = 3;
/// Share of repeated frames from which on they are reported.
const REPORTED_SHARE: f64 = 0.05;

/// Run of repetitions from which on the picture counts as standing still.
const STILL_RUN: u64 = 10;

/// Frames that repeat the picture of the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Repetitions {
    /// All of them.
    pub frames: u64,
    /// The longest run of them.
    pub longest: u64,
}

/// Steps between the frames of a video.
#[derive(Debug, Default)]
pub(crate) struct RepetitionPass {
    before: Option<Rgb8Image>,
    /// Mean differences of bytes.
    steps: Vec<f64>,
}

impl RepetitionPass {
    /// Takes the next frame, at a small size.
    pub(crate) fn observe(&mut self, image: Rgb8Image) {
        if let Some(before) = &self.before {
            let pairs = before.data.iter().zip(&image.data);
            let sum: u64 = pairs.map(|(a, &b)| u64::from(a.abs_diff(b))).sum();
            self.steps.push(sum as f64 / image.data.len().max(1) as f64);
        }
        self.before = Some(image);
    }

    /// Returns the frames that repeat the one before.
    pub(crate) fn finish(&self) -> Repetitions {
        let largest = |steps: &[f64]| steps.iter().copied().reduce(f64::max);
        let repeats = |at: usize| {
            let (before, others) = self.steps.split_at(at);
            let Some((step, behind)) = others.split_first() else {
                return false;
            };
            // Not a byte differs: noise of a camera that stands leaves some (0.004 over five clips).
            if *step == 0.0 {
                return true;
            }
            let before = &before[before.len().saturating_sub(REACH)..];
            let behind = &behind[..behind.len().min(REACH)];
            match (largest(before), largest(behind)) {
                (Some(before), Some(behind)) => *step < LARGEST_RATIO * before.min(behind),
                _ => false,
            }
        };
        let mut found = Repetitions::default();
        let mut run = 0;
        for at in 0..self.steps.len() {
            run = if repeats(at) { run + 1 } else { 0 };
            found.frames += u64::from(run > 0);
            found.longest = found.longest.max(run);
        }
        found
    }
}

/// Returns a line on repeated frames; `None` where they are few.
pub(crate) fn note(found: Repetitions, frames: u64, frames_per_second: f64) -> Option<String> {
    let Repetitions {
        frames: repeated,
        longest,
    } = found;
    if longest >= STILL_RUN {
        return Some(format!(
            "{repeated} of {frames} frames repeat the picture before them, up to {longest} in a row: the picture stands \
             still; sampled frames may be copies of each other"
        ));
    }
    let share = repeated as f64 / frames.max(1) as f64;
    (share >= REPORTED_SHARE).then(|| {
        format!(
            "{repeated} of {frames} frames repeat the picture before them: it shows about {:.1} pictures a second, \
             stored at {frames_per_second:.1}; sampled frames may be pairs of one picture",
            (1.0 - share) * frames_per_second
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts repetitions among frames of these pictures: every picture is a ramp that moves, with some noise.
    fn count(pictures: impl Iterator<Item = usize>, speed: usize) -> u64 {
        let mut pass = RepetitionPass::default();
        for (frame, picture) in pictures.enumerate() {
            let pixel = |at: usize| (at * 7 + speed * picture) as u8 / 2 + (at * frame % 2) as u8;
            pass.observe(Rgb8Image {
                width: 16,
                height: 8,
                data: (0..3 * 16 * 8).map(pixel).collect(),
            });
        }
        pass.finish().frames
    }

    #[test]
    fn repeated_pictures_are_counted_and_still_ones_are_not() {
        assert_eq!(count(0..40, 37), 0);
        // 15 in 30, 24 in 30, 10 in 30; the first and the last steps have one side alone.
        assert_eq!(count((0..40).map(|frame| frame / 2), 37), 18);
        let telecine = count((0..40).map(|frame| frame * 4 / 5), 37);
        assert!((7..=8).contains(&telecine), "{telecine}");
        assert_eq!(count((0..39).map(|frame| frame / 3), 37), 22);
        // A camera that stands, with noise; a single cut.
        assert_eq!(count((0..40).map(|_| 0), 37), 0);
        assert_eq!(count((0..40).map(|frame| frame / 20), 37), 0);
        assert_eq!(count(std::iter::empty(), 1), 0);
    }

    #[test]
    fn few_repetitions_are_not_reported() {
        let few = |frames: u64, longest: u64| note(Repetitions { frames, longest }, 100, 30.0);
        assert_eq!(few(4, 1), None);
        assert!(few(50, 1).is_some_and(|line| line.contains("about 15.0 pictures")));
        assert!(few(20, 20).is_some_and(|line| line.contains("20 in a row")));
    }

    /// Twenty frames of one picture, to the byte, in a video that moves.
    #[test]
    fn a_frozen_picture_is_counted_whole() {
        let mut pass = RepetitionPass::default();
        for frame in 0..60_usize {
            let picture = if (20..41).contains(&frame) { 20 } else { frame };
            let pixel = |at: usize| (at * 7 + 37 * picture) as u8 / 2;
            pass.observe(Rgb8Image {
                width: 16,
                height: 8,
                data: (0..3 * 16 * 8).map(pixel).collect(),
            });
        }
        let expected = Repetitions {
            frames: 20,
            longest: 20,
        };
        assert_eq!(pass.finish(), expected);
    }
}
