//! Features of positions, and their gradients by the table and by the positions.
//!
//! Gradients by a table are summed level by level, rows in order, in f64. The sum does not depend on the
//! number of threads, and is accurate for a million rows in one cell.

use rayon::prelude::*;

use super::levels::{FEATURES, HashGrid, Level, MAX_DIMENSIONS};

/// Maximum number of corners of a cell.
const CORNERS: usize = 1 << MAX_DIMENSIONS;

/// A level's cell around a position.
struct Cell<const D: usize> {
    first: [u32; D],
    fraction: [f32; D],
}

impl<const D: usize> Cell<D> {
    #[inline]
    fn of(level: &Level, position: &[f32; D]) -> Self {
        let mut cell = Self {
            first: [0; D],
            fraction: [0.0; D],
        };
        for (axis, value) in position.iter().enumerate() {
            // At least 1/2, so that truncation equals floor.
            let at = value.clamp(0.0, 1.0) * level.scale + 0.5;
            cell.first[axis] = at as u32;
            cell.fraction[axis] = at - cell.first[axis] as f32;
        }
        cell
    }

    /// Returns the corner with the upper cell along the axes whose bits are set.
    #[inline]
    fn corner(&self, bits: usize) -> [u32; D] {
        std::array::from_fn(|axis| self.first[axis] + ((bits >> axis) & 1) as u32)
    }

    /// Returns the weights of the corners, by their bits.
    #[inline]
    fn weights(&self) -> [f32; CORNERS] {
        let mut weights = [1.0; CORNERS];
        for (axis, fraction) in self.fraction.iter().enumerate() {
            let half = 1 << axis;
            for low in 0..half {
                weights[low + half] = weights[low] * fraction;
                weights[low] *= 1.0 - fraction;
            }
        }
        weights
    }

    /// Returns the derivative along an axis, per cell, of the interpolated `values` of the corners.
    #[inline]
    fn derivative(&self, mut values: [f32; CORNERS], along: usize) -> f32 {
        for axis in (0..D).rev() {
            let half = 1 << axis;
            for low in 0..half {
                let difference = values[low + half] - values[low];
                values[low] = if axis == along {
                    difference
                } else {
                    values[low] + self.fraction[axis] * difference
                };
            }
        }
        values[0]
    }
}

fn is_finite(position: &[f32]) -> bool {
    position.iter().all(|value| value.is_finite())
}

fn position_of<const D: usize>(values: &[f32]) -> [f32; D] {
    std::array::from_fn(|axis| values[axis])
}

impl HashGrid {
    /// Writes the first `active` features of a position (`dimensions` values) into `out` (`features()`
    /// values). The others, and those of a position that is not finite, are 0.
    pub fn encode(&self, position: &[f32], table: &[f32], active: usize, out: &mut [f32]) {
        debug_assert_eq!(position.len(), self.shape.dimensions);
        match self.shape.dimensions {
            2 => self.encode_in::<2>(position, table, active, out),
            3 => self.encode_in::<3>(position, table, active, out),
            _ => self.encode_in::<4>(position, table, active, out),
        }
    }

    fn encode_in<const D: usize>(
        &self,
        position: &[f32],
        table: &[f32],
        active: usize,
        out: &mut [f32],
    ) {
        out.fill(0.0);
        if !is_finite(position) {
            return;
        }
        let position = position_of::<D>(position);
        for (level, out) in self.used(active).zip(out.chunks_exact_mut(FEATURES)) {
            let cell = Cell::of(level, &position);
            let rows = rows(level, table);
            let mut sums = [0.0; FEATURES];
            let weights = cell.weights();
            for (bits, weight) in weights.iter().enumerate().take(1 << D) {
                let row = &rows[level.entry(cell.corner(bits)) as usize];
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum += weight * value;
                }
            }
            out.copy_from_slice(&sums);
        }
        out[active.min(self.features())..].fill(0.0);
    }

    fn used(&self, active: usize) -> impl Iterator<Item = &Level> {
        self.levels.iter().take(active.div_ceil(FEATURES))
    }

    /// Overwrites `gradients` by the table's from those by the features (rows of `features()`) at positions
    /// (rows of `dimensions`). Positions that are not finite are skipped.
    pub fn backward_table(
        &self,
        positions: &[f32],
        active: usize,
        upstream: &[f32],
        gradients: &mut [f32],
    ) {
        match self.shape.dimensions {
            2 => self.backward_table_in::<2>(positions, active, upstream, gradients),
            3 => self.backward_table_in::<3>(positions, active, upstream, gradients),
            _ => self.backward_table_in::<4>(positions, active, upstream, gradients),
        }
    }

    fn backward_table_in<const D: usize>(
        &self,
        positions: &[f32],
        active: usize,
        upstream: &[f32],
        gradients: &mut [f32],
    ) {
        let features = self.features();
        let mut rest = gradients;
        let mut of_levels = Vec::with_capacity(self.levels.len());
        for level in &self.levels {
            let (own, after) = rest.split_at_mut(FEATURES * level.entries as usize);
            of_levels.push(own);
            rest = after;
        }
        of_levels
            .into_par_iter()
            .enumerate()
            .for_each(|(number, gradients)| {
                let used = active.saturating_sub(number * FEATURES).min(FEATURES);
                if used == 0 {
                    gradients.fill(0.0);
                    return;
                }
                let level = &self.levels[number];
                let mut sums = vec![[0.0_f64; FEATURES]; level.entries as usize];
                let rows = positions
                    .chunks_exact(D)
                    .zip(upstream.chunks_exact(features));
                for (position, upstream) in rows {
                    let upstream = &upstream[number * FEATURES..number * FEATURES + used];
                    if upstream.iter().all(|&value| value == 0.0) || !is_finite(position) {
                        continue;
                    }
                    let cell = Cell::of(level, &position_of::<D>(position));
                    let weights = cell.weights();
                    for (bits, weight) in weights.iter().enumerate().take(1 << D) {
                        let sums = &mut sums[level.entry(cell.corner(bits)) as usize];
                        for (sum, value) in sums.iter_mut().zip(upstream) {
                            *sum += f64::from(weight * value);
                        }
                    }
                }
                for (gradient, sum) in gradients.iter_mut().zip(sums.as_flattened()) {
                    *gradient = *sum as f32;
                }
            });
    }

    /// Writes the gradient by one position from that by its features; 0 along axes where it is clamped.
    pub fn backward_position(
        &self,
        position: &[f32],
        table: &[f32],
        active: usize,
        upstream: &[f32],
        gradient: &mut [f32],
    ) {
        match self.shape.dimensions {
            2 => self.backward_position_in::<2>(position, table, active, upstream, gradient),
            3 => self.backward_position_in::<3>(position, table, active, upstream, gradient),
            _ => self.backward_position_in::<4>(position, table, active, upstream, gradient),
        }
    }

    fn backward_position_in<const D: usize>(
        &self,
        position: &[f32],
        table: &[f32],
        active: usize,
        upstream: &[f32],
        gradient: &mut [f32],
    ) {
        gradient.fill(0.0);
        if !is_finite(position) {
            return;
        }
        let position = position_of::<D>(position);
        for (number, level) in self.used(active).enumerate() {
            let used = active.saturating_sub(number * FEATURES).min(FEATURES);
            let upstream = &upstream[number * FEATURES..number * FEATURES + used];
            let cell = Cell::of(level, &position);
            let rows = rows(level, table);
            let mut values = [0.0; CORNERS];
            for (bits, value) in values.iter_mut().enumerate().take(1 << D) {
                let row = &rows[level.entry(cell.corner(bits)) as usize];
                *value = upstream.iter().zip(row).map(|(a, b)| a * b).sum();
            }
            for (axis, gradient) in gradient.iter_mut().enumerate() {
                *gradient += level.scale * cell.derivative(values, axis);
            }
        }
        for (gradient, value) in gradient.iter_mut().zip(position) {
            if !(0.0..=1.0).contains(&value) {
                *gradient = 0.0;
            }
        }
    }
}

/// Returns a level's part of a table.
fn rows<'a>(level: &Level, table: &'a [f32]) -> &'a [[f32; FEATURES]] {
    let (rows, _) = table.as_chunks();
    &rows[level.first_entry..level.first_entry + level.entries as usize]
}
