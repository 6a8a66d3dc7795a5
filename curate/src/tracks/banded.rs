//! Symmetric positive definite systems of equations whose matrix is a band.

/// The lower half of a symmetric band matrix.
#[derive(Debug, Clone)]
pub struct BandMatrix {
    size: usize,
    /// Entries beside the diagonal, to one side.
    reach: usize,
    /// Row by row, the diagonal last.
    rows: Vec<f64>,
}

impl BandMatrix {
    /// Creates a matrix of zeros.
    pub fn new(size: usize, reach: usize) -> Self {
        Self {
            size,
            reach,
            rows: vec![0.0; size * (reach + 1)],
        }
    }

    fn place(&self, row: usize, column: usize) -> usize {
        row * (self.reach + 1) + self.reach + column - row
    }

    /// Adds to the entry in `row` and `column`, which must not be above the diagonal, and to its mirror image.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        debug_assert!(column <= row && row - column <= self.reach);
        let place = self.place(row, column);
        self.rows[place] += value;
    }

    /// Returns the diagonal entry of a row.
    pub fn diagonal(&self, row: usize) -> f64 {
        self.rows[self.place(row, row)]
    }

    /// Solves `A x = right` by Cholesky's decomposition; `None` if the matrix is not positive definite.
    pub fn solve(mut self, right: &[f64]) -> Option<Vec<f64>> {
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
                    // Written so that NaN is refused.
                    let is_positive = value > 0.0 && value.is_finite();
                    is_positive.then_some(())?;
                    self.rows[at] = value.sqrt();
                }
            }
        }
        let mut x = right.to_vec();
        for row in 0..self.size {
            let first = row.saturating_sub(self.reach);
            let known: f64 = (first..row)
                .map(|column| self.rows[self.place(row, column)] * x[column])
                .sum();
            x[row] = (x[row] - known) / self.diagonal(row);
        }
        for row in (0..self.size).rev() {
            let last = (row + self.reach).min(self.size - 1);
            let known: f64 = (row + 1..=last)
                .map(|below| self.rows[self.place(below, row)] * x[below])
                .sum();
            x[row] = (x[row] - known) / self.diagonal(row);
        }
        Some(x)
    }
}

#[cfg(test)]
mod tests {
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
}
