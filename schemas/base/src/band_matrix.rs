//! Symmetric positive definite systems of equations with a band matrix; a band as wide as the matrix is dense.

use std::{
    iter::Sum,
    ops::{Div, Mul, Sub},
};

/// Lower half of a symmetric band matrix.
#[derive(Debug, Clone)]
pub struct BandMatrix {
    size: usize,
    /// Entries beside the diagonal, to one side.
    reach: usize,
    /// Entries row by row, the diagonal last.
    rows: Vec<f64>,
    /// Share of its diagonal entry that every pivot exceeds.
    least_pivot: f64,
}

impl BandMatrix {
    /// Makes a matrix of zeros.
    pub fn new(size: usize, reach: usize) -> Self {
        Self {
            size,
            reach,
            rows: vec![0.0; size * (reach + 1)],
            least_pivot: 0.0,
        }
    }

    /// Refuses a solution with a pivot of at most this share of its diagonal entry, a measure of condition that is
    /// independent of units.
    pub fn with_least_pivot(self, least_pivot: f64) -> Self {
        Self {
            least_pivot,
            ..self
        }
    }

    fn place(&self, row: usize, column: usize) -> usize {
        row * (self.reach + 1) + self.reach + column - row
    }

    /// Adds to the entry in `row` and `column`, which is not above the diagonal, and to its mirror image.
    #[inline]
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        debug_assert!(column <= row && row - column <= self.reach);
        let place = self.place(row, column);
        self.rows[place] += value;
    }

    /// Returns the diagonal entry of a row.
    pub fn diagonal(&self, row: usize) -> f64 {
        self.rows[self.place(row, row)]
    }

    /// Solves `A x = right` for scalars or vectors `x`; `None` where the matrix is not positive definite.
    pub fn solve<T>(self, right: &[T]) -> Option<Vec<T>>
    where
        T: Copy + Sum + Sub<Output = T> + Div<f64, Output = T>,
        f64: Mul<T, Output = T>,
    {
        let factor = self.decomposed()?;
        let mut x = right.to_vec();
        for row in 0..factor.size {
            let first = row.saturating_sub(factor.reach);
            let known: T = (first..row)
                .map(|column| factor.rows[factor.place(row, column)] * x[column])
                .sum();
            x[row] = (x[row] - known) / factor.diagonal(row);
        }
        for row in (0..factor.size).rev() {
            let last = (row + factor.reach).min(factor.size - 1);
            let known: T = (row + 1..=last)
                .map(|below| factor.rows[factor.place(below, row)] * x[below])
                .sum();
            x[row] = (x[row] - known) / factor.diagonal(row);
        }
        Some(x)
    }

    /// Replaces the matrix by its Cholesky factor.
    fn decomposed(mut self) -> Option<Self> {
        for row in 0..self.size {
            let first = row.saturating_sub(self.reach);
            for column in first..=row {
                let common = first.max(column.saturating_sub(self.reach));
                let mut value = self.rows[self.place(row, column)];
                for inner in common..column {
                    let (a, b) = (self.place(row, inner), self.place(column, inner));
                    value -= self.rows[a] * self.rows[b];
                }
                let at = self.place(row, column);
                if column < row {
                    self.rows[at] = value / self.rows[self.place(column, column)];
                } else {
                    // This form refuses NaN and infinity too.
                    let is_positive = value > self.least_pivot * self.rows[at];
                    is_positive.then_some(())?;
                    self.rows[at] = value.sqrt();
                }
            }
        }
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, dvec3};
    use proptest::prelude::*;

    use super::*;

    #[test]
    #[expect(
        clippy::needless_range_loop,
        reason = "rows and columns of two matrices"
    )]
    fn the_solution_solves() {
        let (size, reach) = (12, 3);
        let value = |row: usize, column: usize| ((row * 7 + column * 3) as f64).sin();
        let mut matrix = BandMatrix::new(size, reach);
        let mut full = vec![vec![0.0; size]; size];
        for row in 0..size {
            for column in row.saturating_sub(reach)..=row {
                let entry = if row == column {
                    9.0
                } else {
                    value(row, column)
                };
                matrix.add(row, column, entry);
                full[row][column] = entry;
                full[column][row] = entry;
            }
        }
        let right: Vec<f64> = (0..size).map(|row| (row as f64).cos()).collect();
        let x = matrix.solve(&right).expect("definite");
        for (row, right) in full.iter().zip(&right) {
            let product: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
            assert!((product - right).abs() < 1e-12);
        }
        let mut indefinite = BandMatrix::new(2, 1);
        indefinite.add(0, 0, 1.0);
        indefinite.add(1, 0, 2.0);
        indefinite.add(1, 1, 1.0);
        assert_eq!(indefinite.solve(&[1.0, 1.0]), None);
    }

    #[test]
    fn small_pivots_are_refused_in_any_unit() {
        for scale in [1e-8, 1.0, 1e8] {
            let solved = |least: f64| {
                let mut matrix = BandMatrix::new(2, 1).with_least_pivot(least);
                matrix.add(0, 0, 1.0);
                matrix.add(1, 0, scale);
                matrix.add(1, 1, scale * scale * (1.0 + 1e-6));
                matrix.solve(&[1.0, scale])
            };
            assert!(solved(0.0).is_some() && solved(1e-7).is_some());
            assert_eq!(solved(1e-5), None);
        }
        for value in [f64::NAN, f64::INFINITY] {
            let mut matrix = BandMatrix::new(1, 0);
            matrix.add(0, 0, value);
            assert_eq!(matrix.solve(&[1.0]), None);
        }
    }

    proptest! {
        /// `A = F F^T + 1` for any lower triangle `F` of a band, and any vectors.
        #[test]
        fn vectors_come_back(
            size in 1_usize..9,
            reach in 0_usize..9,
            values in prop::collection::vec(-1.0..1.0, 81),
            places in prop::collection::vec(-1.0..1.0, 27),
        ) {
            let factor = |row: usize, column: usize| {
                let is_in_band = column <= row && row - column <= reach;
                if is_in_band { values[9 * row + column] } else { 0.0 }
            };
            let entry = |row: usize, column: usize| {
                let product: f64 = (0..size).map(|k| factor(row, k) * factor(column, k)).sum();
                product + f64::from(u8::from(row == column))
            };
            let place = |row: usize| dvec3(places[3 * row], places[3 * row + 1], places[3 * row + 2]);
            let mut matrix = BandMatrix::new(size, reach);
            for row in 0..size {
                for column in row.saturating_sub(reach)..=row {
                    matrix.add(row, column, entry(row, column));
                }
            }
            let right: Vec<DVec3> = (0..size)
                .map(|row| (0..size).map(|column| entry(row, column) * place(column)).sum())
                .collect();
            let found = matrix.solve(&right).unwrap_or_default();
            prop_assert_eq!(found.len(), size);
            for (row, found) in found.into_iter().enumerate() {
                prop_assert!((found - place(row)).length() < 1e-12);
            }
        }
    }
}
