//! Left-right check: the two views must agree on a place.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::stereo::{
    SweptDepth,
    warp::{ErpRays, bilinear, erp_pixel},
};

/// Maximum difference of the two views, in steps of the search.
const TOLERANCE_STEPS: f32 = 1.5;

/// Checks `view` against `other`, and fills pixels that fail. `turn` and `shift` lead from its camera's frame to
/// the other's; `step` is the search's step of inverse distance.
///
/// A pixel that fails is visible in one view alone, or matched wrongly. Its inverse distance becomes the smaller
/// of those of the nearest good pixels on both sides of its row (which is a circle): hidden surfaces are behind.
/// Its confidence becomes 0.
pub(super) fn checked(
    view: &SweptDepth,
    other: &SweptDepth,
    turn: Mat3,
    shift: Vec3,
    step: f32,
) -> SweptDepth {
    let (width, height) = (view.width, view.height);
    let rays = ErpRays::new(width, height);
    let mut checked = view.clone();
    checked
        .inverse_distances
        .par_chunks_mut(width)
        .zip(checked.confidences.par_chunks_mut(width))
        .enumerate()
        .for_each(|(row, (inverse_distances, confidences))| {
            let is_good: Vec<bool> = inverse_distances
                .iter()
                .enumerate()
                .map(|(column, &inverse)| {
                    let seen = turn * rays.ray(column, row) + inverse * shift;
                    is_confirmed(other, seen, inverse, step)
                })
                .collect();
            fill(inverse_distances, &is_good);
            for (confidence, is_good) in confidences.iter_mut().zip(&is_good) {
                if !is_good {
                    *confidence = 0.0;
                }
            }
        });
    checked.inverse_distances = median(&checked);
    checked
}

/// Returns true if the other view has a surface at its distance of the place. `seen` is the place in its frame,
/// divided by its distance from the first camera.
fn is_confirmed(other: &SweptDepth, seen: Vec3, inverse: f32, step: f32) -> bool {
    let distance = seen.length();
    // At the other camera's own position it sees nothing.
    if distance < 1e-6 {
        return false;
    }
    let expected = inverse / distance;
    let place = erp_pixel(seen, other.width as f32, other.height as f32);
    // One pixel around is enough: at an edge of depth the other pixels belong to another surface.
    bilinear(other.width, other.height, place)
        .iter()
        .any(|&(pixel, weight)| {
            weight > 0.1
                && (other.inverse_distances[pixel] - expected).abs() < TOLERANCE_STEPS * step
        })
}

/// Fills a row from its good entries; a row without any stays as it is.
fn fill(row: &mut [f32], is_good: &[bool]) {
    let width = row.len();
    if !is_good.contains(&true) {
        return;
    }
    // The nearest good entry to the left of every column, and to the right, with wrapping.
    let mut left = vec![0.0; width];
    let mut right = vec![0.0; width];
    let (mut last, mut next) = (0.0, 0.0);
    for step in 0..2 * width {
        let column = step % width;
        if is_good[column] {
            last = row[column];
        }
        left[column] = last;
        let column = width - 1 - column;
        if is_good[column] {
            next = row[column];
        }
        right[column] = next;
    }
    for column in 0..width {
        if !is_good[column] {
            row[column] = left[column].min(right[column]);
        }
    }
}

/// Returns the median of every pixel and its eight neighbours.
fn median(depth: &SweptDepth) -> Vec<f32> {
    let (width, height) = (depth.width, depth.height);
    let mut out = vec![0.0; width * height];
    out.par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, out)| {
            let rows = [row.saturating_sub(1), row, (row + 1).min(height - 1)];
            for (column, value) in out.iter_mut().enumerate() {
                let columns = [(column + width - 1) % width, column, (column + 1) % width];
                let mut values = [0.0; 9];
                for (index, value) in values.iter_mut().enumerate() {
                    *value = depth.inverse_distances[rows[index / 3] * width + columns[index % 3]];
                }
                values.sort_unstable_by(f32::total_cmp);
                *value = values[4];
            }
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_filled_from_behind_and_around_the_seam() {
        let mut row = [9.0, 0.2, 9.0, 9.0, 0.5, 9.0];
        fill(&mut row, &[false, true, false, false, true, false]);
        assert_eq!(row, [0.2, 0.2, 0.2, 0.2, 0.5, 0.2]);
        let mut degenerate = [1.0, 2.0];
        fill(&mut degenerate, &[false, false]);
        assert_eq!(degenerate, [1.0, 2.0]);
    }
}
