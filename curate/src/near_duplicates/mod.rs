//! Videos with the same footage in different files: re-encoded, scaled, cropped in time, turned about the vertical.
//!
//! Signatures of two videos are compared at every shift in time. For the same footage they differ by little relative to
//! their change over time; for another part of the same place they differ by as much. Nothing is dropped: pairs are
//! reported.

pub(crate) mod signature;

use std::path::Path;

use omnilife_schemas::{
    layout::SIGNATURE_FILE,
    records::{Dataset, VideoStatus},
};
use rayon::prelude::*;

use crate::{boundaries::Signals, error::CurateError};
pub use signature::SignaturePass;
use signature::{NUMBERS, Numbers, WINDOW_SECONDS, rows};

/// Mean squared difference of two signatures over their variance in time, below which they show the same footage; set
/// on the clips that `docs/results/curation.md` names.
pub const LIMIT: f64 = 0.8;
/// Standard deviation that a codec leaves in static content; levels are 0 to 1.
const FLOOR: f64 = 0.004;
/// Shortest overlap that is compared, windows.
const LEAST_WINDOWS: usize = 12;

/// Two videos with footage in common.
#[derive(Debug, Clone, PartialEq)]
pub struct NearDuplicate {
    /// Number of the later video in the record.
    pub video: usize,
    /// Number of the video before it.
    pub of: usize,
    /// Start of the common footage in the later video, seconds after its first frame.
    pub begin_seconds: f64,
    /// Its start in the other video.
    pub begin_in_other_seconds: f64,
    /// Its length.
    pub seconds: f64,
    /// The ratio that is below [`LIMIT`].
    pub difference: f64,
    /// True if so little changes over time that another part of the same static place looks the same.
    pub is_still: bool,
}

/// Best alignment of two signatures.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Overlay {
    /// First windows of both, and how many.
    first: [usize; 2],
    windows: usize,
    difference: f64,
    is_still: bool,
}

/// Returns pairs of curated videos of the dataset in `out` with footage in common, in order of the videos. A folder of
/// an older version without a signature is left out.
///
/// # Errors
/// When a signature cannot be read.
pub fn find(dataset: &Dataset, out: &Path) -> Result<Vec<NearDuplicate>, CurateError> {
    let mut signatures: Vec<(usize, Vec<f64>, Vec<Numbers>)> = Vec::new();
    for (number, video) in dataset.videos.iter().enumerate() {
        let VideoStatus::Curated { sequences } = &video.status else {
            continue;
        };
        let folder = sequences.first().and_then(|first| first.rsplit_once('/'));
        let file = folder.map(|(folder, _)| out.join(folder).join(SIGNATURE_FILE));
        let Some(file) = file.filter(|file| file.is_file()) else {
            continue;
        };
        let signals = Signals::read_parquet(&file)?;
        let rows = rows(&signals)
            .ok_or_else(|| CurateError::input(&file, "must be a table of a signature"))?;
        signatures.push((number, signals.times, rows));
    }
    let pairs: Vec<(usize, usize)> = (0..signatures.len())
        .flat_map(|later| (0..later).map(move |earlier| (later, earlier)))
        .collect();
    let found = pairs.par_iter().filter_map(|&(later, earlier)| {
        let (video, times, a) = &signatures[later];
        let (of, times_of_other, b) = &signatures[earlier];
        let overlay = best_overlay(a, b)?;
        let [first, first_in_other] = overlay.first;
        let last = first + overlay.windows - 1;
        Some(NearDuplicate {
            video: *video,
            of: *of,
            begin_seconds: times[first],
            begin_in_other_seconds: times_of_other[first_in_other],
            seconds: times[last] - times[first] + WINDOW_SECONDS,
            difference: overlay.difference,
            is_still: overlay.is_still,
        })
    });
    Ok(found.collect())
}

/// Returns the overlay with the smallest difference, if that is below the limit.
fn best_overlay(a: &[Numbers], b: &[Numbers]) -> Option<Overlay> {
    let (moments_a, moments_b) = (Moments::of(a), Moments::of(b));
    let least = LEAST_WINDOWS;
    if a.len() < least || b.len() < least {
        return None;
    }
    let behind = (0..=a.len() - least).map(|at| [at, 0]);
    let before = (1..=b.len() - least).map(|at| [0, at]);
    behind
        .chain(before)
        .filter_map(|[i, j]| {
            let windows = (a.len() - i).min(b.len() - j);
            let changes = moments_a
                .variance(i, windows)
                .min(moments_b.variance(j, windows));
            let scale = changes + FLOOR * FLOOR;
            let (a, b) = (&a[i..i + windows], &b[j..j + windows]);
            Some(Overlay {
                first: [i, j],
                windows,
                difference: mean_square_difference(a, b, LIMIT * scale)? / scale,
                is_still: changes < FLOOR * FLOOR,
            })
        })
        .min_by(|a, b| a.difference.total_cmp(&b.difference))
}

/// Returns `None` from a limit on, which most pairs of rows reach after a few.
fn mean_square_difference(a: &[Numbers], b: &[Numbers], limit: f64) -> Option<f64> {
    let count = (a.len() * NUMBERS) as f64;
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
        sum += f64::from(squares.sum::<f32>());
        if sum >= limit * count {
            return None;
        }
    }
    Some(sum / count)
}

/// Sums over the rows before each, so that variances of any part cost the same.
struct Moments {
    sums: Vec<[f64; NUMBERS]>,
    squares: Vec<f64>,
}

impl Moments {
    fn of(rows: &[Numbers]) -> Self {
        let (mut sum, mut square) = ([0.0; NUMBERS], 0.0);
        let (mut sums, mut squares) = (vec![sum], vec![square]);
        for row in rows {
            for (sum, &value) in sum.iter_mut().zip(row) {
                *sum += f64::from(value);
                square += f64::from(value) * f64::from(value);
            }
            sums.push(sum);
            squares.push(square);
        }
        Self { sums, squares }
    }

    /// Returns the variance in time of a part, mean over the numbers.
    fn variance(&self, first: usize, count: usize) -> f64 {
        let n = count as f64;
        let square = (self.squares[first + count] - self.squares[first]) / n;
        let (from, to) = (&self.sums[first], &self.sums[first + count]);
        let means = to.iter().zip(from).map(|(to, from)| (to - from) / n);
        let of_means: f64 = means.map(|mean| mean * mean).sum();
        ((square - of_means) / NUMBERS as f64).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Returns a synthetic signature that wanders.
    fn footage(seed: u64, windows: usize) -> Vec<Numbers> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut row = [0.5; NUMBERS];
        (0..windows)
            .map(|_| {
                for number in &mut row {
                    *number += 0.03 * (random.random::<f32>() - 0.5);
                }
                row
            })
            .collect()
    }

    #[test]
    fn a_part_is_found_where_it_lies_and_another_part_is_not() {
        let whole = footage(0, 120);
        let mut part: Vec<Numbers> = whole[40..100].to_vec();
        for (index, row) in part.iter_mut().enumerate() {
            row[index % NUMBERS] += 0.003;
        }
        let found = best_overlay(&part, &whole).expect("the part");
        assert_eq!((found.first, found.windows), ([0, 40], 60));
        assert!(found.difference < 0.1 && !found.is_still, "{found:?}");
        let back = best_overlay(&whole, &part).expect("the whole");
        assert_eq!(back.first, [40, 0]);
        assert_eq!(best_overlay(&footage(1, 60), &whole[..60]), None);
        assert_eq!(best_overlay(&whole[..5], &whole), None, "too short");
    }

    #[test]
    fn variances_of_parts_are_those_of_their_rows() {
        let rows = footage(2, 50);
        let part = &rows[7..33];
        let mut expected = 0.0;
        for number in 0..NUMBERS {
            let values: Vec<f64> = part.iter().map(|row| f64::from(row[number])).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
            expected += squares / values.len() as f64 / NUMBERS as f64;
        }
        let found = Moments::of(&rows).variance(7, 26);
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn what_does_not_change_is_still() {
        let rows = vec![[0.4; NUMBERS]; 30];
        let found = best_overlay(&rows, &rows).expect("the same");
        assert!(found.is_still);
    }
}
