//! Candidate cuts between looked-at frames, while a video is decoded: `parts` keeps sums over time apart there.
//!
//! Boundaries are known only after the pass. The layout of a panorama, its coarse levels without the mean of each
//! latitude, survives the steps of a walking camera. It changes at once where another shot begins. A turn changes it
//! over several steps, so a cut also stands out from the steps before it, which is its score. Too many candidates cost
//! memory and no precision.

use std::collections::VecDeque;

/// Columns and rows of a layout.
const COLUMNS: usize = 32;
const ROWS: usize = 16;
/// Least change of a candidate: 1 less the correlation of the layouts. Cuts of an edited street film have 0.8 and
/// more, its other steps up to 0.53.
const LEAST_CHANGE: f64 = 0.4;
/// Number of steps before a candidate whose mean change its own is compared with.
const STEPS_BEFORE: usize = 4;
/// Least root of the squares of a layout that shows anything, 8-bit levels: below, all is noise.
const LEAST_NORM: f64 = 4.0;

/// Compares each frame with the one before.
#[derive(Debug, Default)]
pub(super) struct CutSignal {
    last: Option<Vec<f64>>,
    changes: VecDeque<f64>,
}

impl CutSignal {
    /// Takes the levels of the next frame, row by row, each 0 to 255. Returns the score if a shot may end before it: its
    /// change less the mean change of the steps before.
    pub(super) fn candidate(
        &mut self,
        width: usize,
        levels: impl Iterator<Item = f32>,
    ) -> Option<f64> {
        let layout = layout(width, levels);
        let before = self.last.replace(layout.clone())?;
        let change = change(&before, &layout);
        let typical = self.changes.iter().sum::<f64>() / self.changes.len().max(1) as f64;
        self.changes.push_back(change);
        if self.changes.len() > STEPS_BEFORE {
            self.changes.pop_front();
        }
        (change >= LEAST_CHANGE).then_some(change - typical)
    }
}

/// Returns the mean levels of blocks less the mean of their row.
fn layout(width: usize, levels: impl Iterator<Item = f32>) -> Vec<f64> {
    let height = (width / 2).max(1);
    let mut sums = vec![0.0; COLUMNS * ROWS];
    let mut counts = vec![0.0; COLUMNS * ROWS];
    for (at, level) in levels.enumerate() {
        let column = at % width.max(1) * COLUMNS / width.max(1);
        let row = (at / width.max(1) * ROWS / height).min(ROWS - 1);
        sums[row * COLUMNS + column] += f64::from(level);
        counts[row * COLUMNS + column] += 1.0;
    }
    for (sum, count) in sums.iter_mut().zip(&counts) {
        *sum /= f64::max(*count, 1.0);
    }
    for row in sums.chunks_exact_mut(COLUMNS) {
        let mean = row.iter().sum::<f64>() / COLUMNS as f64;
        for value in row {
            *value -= mean;
        }
    }
    sums
}

/// Returns 1 less the correlation of two layouts: 0 of equal ones, up to 2. A layout without content equals another
/// one without and none with.
fn change(one: &[f64], other: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let norms = [one, other].map(|layout| dot(layout, layout).sqrt());
    match norms.map(|norm| norm >= LEAST_NORM) {
        [true, true] => 1.0 - dot(one, other) / (norms[0] * norms[1]),
        [false, false] => 0.0,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 128;

    /// Two waves around the sphere, one phase a latitude, over a bright sky.
    fn levels(turn: f32, phase: f32) -> impl Iterator<Item = f32> {
        (0..WIDTH * WIDTH / 2).map(move |at| {
            let (x, y) = ((at % WIDTH) as f32, (at / WIDTH) as f32);
            let around = 2.0 * std::f32::consts::PI * x / WIDTH as f32 + turn;
            let sky = if y < 20.0 { 80.0 } else { 0.0 };
            100.0 + sky + 40.0 * (2.0 * around + phase * (0.2 * y).sin()).sin()
        })
    }

    /// Returns the numbers of the frames before which a shot may end, with the scores.
    fn candidates(frames: impl IntoIterator<Item = (f32, f32)>) -> Vec<(usize, f64)> {
        let mut signal = CutSignal::default();
        let frames = frames.into_iter().enumerate();
        let found = frames.filter_map(|(number, (turn, phase))| {
            let score = signal.candidate(WIDTH, levels(turn, phase))?;
            Some((number, score))
        });
        found.collect()
    }

    #[test]
    fn a_cut_is_a_candidate_and_stands_out_from_a_turn() {
        let step = |number: usize| 0.05 * number as f32;
        assert!(candidates((0..8).map(|n| (step(n), 0.0))).is_empty());
        let cut = candidates((0..8).map(|n| (step(n), if n < 5 { 0.0 } else { 9.0 })));
        assert_eq!(cut.len(), 1, "{cut:?}");
        assert_eq!(cut[0].0, 5);
        assert!(cut[0].1 > LEAST_CHANGE - 0.1, "{cut:?}");
        // A quarter of the wave in each step: the layouts never correlate, and no step stands out from those before.
        let turning = (0..8).map(|n| (0.25 * std::f32::consts::PI * n as f32, 0.0));
        let turning = candidates(turning);
        assert_eq!(turning.len(), 7, "{turning:?}");
        assert!(turning[1..].iter().all(|(_, score)| score.abs() < 0.05));
    }

    #[test]
    fn the_brightness_of_latitudes_is_no_layout() {
        let flat = |level: f32| move |at: usize| if at / WIDTH < 20 { 200.0 } else { level };
        let one = layout(WIDTH, (0..WIDTH * WIDTH / 2).map(flat(50.0)));
        let other = layout(WIDTH, levels(0.0, 0.0));
        assert!(one.iter().all(|value| value.abs() < 1e-9));
        assert!(change(&one, &one).abs() < 1e-12);
        assert!((change(&one, &other) - 1.0).abs() < 1e-12);
        assert!(change(&other, &other).abs() < 1e-12);
        let inverse: Vec<f64> = other.iter().map(|value| -value).collect();
        assert!((change(&other, &inverse) - 2.0).abs() < 1e-12);
    }
}
